"""What the operator uses: the `argosy` command."""
