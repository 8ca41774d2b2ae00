"""The nearest of the names that exist, for one that does not."""

from __future__ import annotations

from collections.abc import Iterable

_CLOSE = 0.7
"""How alike two words must be, by `difflib`: a letter or two wrong or missing in a short one."""


def near(word: str, known: Iterable[str], close: float = _CLOSE) -> str:
    """``; did you mean x?`` for a near miss or the same name in a namespace, else nothing.

    A name that exists, with other arguments say, is not misspelt.
    """
    from difflib import get_close_matches  # a program without mistakes starts without it

    names = sorted(known)
    if word in names:
        return ""
    found = [name for name in names if name.endswith(f"::{word}")] or get_close_matches(word, names, 1, close)
    return f"; did you mean {found[0]}?" if found else ""
