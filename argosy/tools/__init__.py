"""Tools on the bus: `argosy act`, `echo`, `hz` and `list`."""
