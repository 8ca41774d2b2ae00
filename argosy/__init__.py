"""The operator's command, `argosy`."""
