"""Small facts that commd keeps beside the mail, by kind and name: what its agents offer, which boards it has heard of.

Plain functions on a connection, for use inside `Store.write` and `Store.read`.
"""

from __future__ import annotations

from sqlite3 import Connection


def keep(db: Connection, kind: str, name: str, value: bytes) -> None:
    """Keep a fact, instead of the one of the same kind and name."""
    db.execute("INSERT OR REPLACE INTO facts(kind, name, value) VALUES(?, ?, ?)", (kind, name, value))


def drop(db: Connection, kind: str, name: str) -> None:
    """Forget a fact; nothing happens if there is none."""
    db.execute("DELETE FROM facts WHERE kind = ? AND name = ?", (kind, name))


def kept(db: Connection, kind: str) -> dict[str, bytes]:
    """Return the facts of a kind by their names, in the order of the names."""
    return dict(db.execute("SELECT name, value FROM facts WHERE kind = ? ORDER BY name", (kind,)))
