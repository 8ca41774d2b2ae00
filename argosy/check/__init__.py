"""`argosy check`: read all that a mission names, and report what is wrong without starting anything."""
