"""argosy.status."""
