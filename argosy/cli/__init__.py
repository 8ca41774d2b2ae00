"""argosy.cli."""
