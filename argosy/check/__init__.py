"""argosy.check."""
