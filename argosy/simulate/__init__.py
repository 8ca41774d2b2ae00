"""argosy.simulate."""
