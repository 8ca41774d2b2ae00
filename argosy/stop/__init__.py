"""argosy.stop."""
