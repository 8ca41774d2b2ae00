"""Deployment to boards: `argosy units`, `argosy board`, `argosy wheelhouse`, and the files they write."""
