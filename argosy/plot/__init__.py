"""argosy.plot."""
