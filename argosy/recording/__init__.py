"""Recordings of a fleet: MCAP files of all that was said on its bus (docs/recording.md)."""
