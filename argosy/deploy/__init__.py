"""argosy.deploy."""
