"""How it is said: the typed Zenoh session that every daemon uses, and the board's comm daemon."""
