"""`argosy plot`: figures and tables of a recording. `data` reads it, `panels` and `map` draw, `figure` composes."""
