"""argosy.mail."""
