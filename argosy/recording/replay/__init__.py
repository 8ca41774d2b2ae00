"""argosy.recording.replay."""
