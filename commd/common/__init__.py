"""commd.common."""
