"""The nearest of the names that exist, for one that does not."""

from __future__ import annotations

from collections.abc import Iterable

_CLOSE = 0.7
"""How alike two words must be, by `difflib`: a letter or two wrong or missing in a short one."""


def similar(word: str, known: Iterable[str], close: float = _CLOSE) -> str | None:
    """Return the known name that a word probably means: a near miss, or the same name in a namespace.

    None if there is no such name, and for a known word: with other arguments it is not misspelt. `close`: the least
    similarity, from 0 to 1.
    """
    from difflib import get_close_matches  # a program without mistakes starts without it

    names = sorted(known)
    if word in names:
        return None
    found = [name for name in names if name.endswith(f"::{word}")] or get_close_matches(word, names, 1, close)
    return found[0] if found else None


def near(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean x?`` for a word that is probably misspelt, else nothing."""
    found = similar(word, known)
    return "" if found is None else f"; did you mean {found}?"
