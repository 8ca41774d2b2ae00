"""argosy.manifest."""
