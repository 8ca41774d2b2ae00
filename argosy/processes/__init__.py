"""argosy.processes."""
