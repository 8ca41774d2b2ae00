"""argosy.run."""
