"""commd.router."""
