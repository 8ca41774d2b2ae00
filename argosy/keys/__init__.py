"""argosy.keys."""
