"""Fly a mission a thousand times in virtual time (`argosy trial`)."""
