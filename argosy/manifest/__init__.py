"""`argosy manifest`: check, convert and print manifest files; read and change the one a robot runs by."""
