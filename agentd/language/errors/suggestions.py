"""The nearest of the names that exist, for one that does not."""

from __future__ import annotations

from collections.abc import Iterable

from schemas.files.findings import nearest

_CLOSE = 0.7
"""The least similarity of two names in a program: a letter or two wrong or missing in a short one."""


def similar(word: str, known: Iterable[str], close: float = _CLOSE) -> str | None:
    """Return `nearest` with the similarity that names in programs need; `close` is a share, 0..1."""
    return nearest(word, known, close)


def near(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean x?`` for a word that is probably misspelt, else nothing."""
    found = nearest(word, known, _CLOSE)
    return "" if found is None else f"; did you mean {found}?"
