"""argosy.recording.file."""
