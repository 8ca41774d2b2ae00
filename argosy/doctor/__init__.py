"""argosy.doctor."""
