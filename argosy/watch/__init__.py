"""`argosy watch`: a running fleet in a terminal. It listens and asks, and orders nothing."""
