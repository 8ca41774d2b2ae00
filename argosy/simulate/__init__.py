"""`argosy simulate` and `argosy referee`: a mission's simulated robots, and the judgement of a search and rescue."""
