"""commd.liveness."""
