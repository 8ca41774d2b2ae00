"""commd.directory."""
