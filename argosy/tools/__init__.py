"""What people look in with and act by hand with: `argosy act`, `echo`, `hz`, `list`, and the codec for zenoh-cli."""
