"""Boards: `argosy units`, `argosy board`, `argosy wheelhouse`, and the files they write."""
