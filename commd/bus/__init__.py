"""commd.bus."""
