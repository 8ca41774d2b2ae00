"""argosy.recording.record."""
