"""`argosy check`: check a mission and all files that it names, without starting anything."""
