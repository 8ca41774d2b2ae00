"""commd.gateway."""
