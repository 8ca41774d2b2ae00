"""The recording file: MCAP records, metadata, reader, writer, and JSON of what it holds."""
