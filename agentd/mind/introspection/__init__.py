"""Records of a mind for people: decisions, failures, snapshots."""
