"""`argosy mail`: what waits in mailboxes, and dead letters."""
