"""Communication: the typed Zenoh session that every daemon uses, and the comm daemon of a board."""
