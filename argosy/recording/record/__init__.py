"""`argosy record`: subscribe to a fleet, fetch what was before, filter, write."""
