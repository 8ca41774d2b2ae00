"""commd.mail."""
