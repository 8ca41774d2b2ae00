"""`argosy stop`: order robots to hold, land or return, above every agent."""
