"""Many agents in one daemon."""
