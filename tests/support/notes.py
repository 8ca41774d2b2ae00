"""Warnings in health, for tests: asserted by what they are, not by their texts."""

from collections.abc import Iterable

from schemas.wire.records import Note


def identities(notes: Iterable[Note]) -> list[tuple[str, str]]:
    """Return code and subject of each note."""
    return [note.identity for note in notes]
