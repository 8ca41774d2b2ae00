"""commd.process."""
