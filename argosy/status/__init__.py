"""`argosy status` and `argosy metrics`: the daemons of a fleet as a table, as JSON, and for Prometheus."""
