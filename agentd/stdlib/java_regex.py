"""Replacing by Java's regular expressions, for ``.replace`` and ``.delete``.

Python's expressions mean the same but for few constructs; those that differ are translated or refused. In the new text
``$1`` and ``${name}`` are groups, and a backslash takes the next character as it is.

A search counts no steps, and may take for ever (``(a+)+$``), so it is limited in time.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Final

from agentd.mind.beliefs.work_limit import limited, substituted
from agentd.mind.data.formula_failure import Failed

_NAMED_GROUP: Final = re.compile(r"\(\?<(?![=!])")
_POSIX: Final = {
    "Alpha": "a-zA-Z",
    "Digit": "0-9",
    "Alnum": "a-zA-Z0-9",
    "Upper": "A-Z",
    "Lower": "a-z",
    "Punct": r"!-/:-@\[-`{-~",
    "Space": r"\s",
}
_CLASS: Final = re.compile(r"\\([pP])\{(\w+)\}")


@lru_cache(maxsize=256)
def compiled(pattern: str) -> re.Pattern[str]:
    """The compiled pattern. Fails with ``unknown`` if it is invalid."""
    if "&&" in pattern and "[" in pattern:
        raise Failed("unknown", f"the pattern '{pattern}': && in brackets is not supported")
    try:
        return re.compile(_CLASS.sub(_posix, _NAMED_GROUP.sub("(?P<", pattern)))
    except (re.error, OverflowError, RecursionError) as error:
        raise Failed("unknown", f"the pattern '{pattern}' cannot be read: {error}") from error


def _posix(match: re.Match[str]) -> str:
    characters = _POSIX.get(match.group(2))
    if characters is None:
        raise Failed("unknown", f"the pattern has a class of characters that is not known: {match.group()}")
    return f"[{'^' if match.group(1) == 'P' else ''}{characters}]"


def replace_all(pattern: str, new: str, whole: str) -> str:
    """``whole`` with every match of ``pattern`` replaced.

    Fails with ``unknown`` where Java throws, ``too_much_work`` or ``too_large``.
    """
    plain = "$" not in new and "\\" not in new
    with limited(f"a search by '{pattern}'"):
        return substituted(".replace", compiled(pattern), lambda at: new if plain else _expanded(new, at), whole)


def _expanded(new: str, match: re.Match[str]) -> str:
    out: list[str] = []
    at = 0
    while at < len(new):
        character = new[at]
        at += 1
        if character == "\\":
            if at == len(new):
                raise Failed("unknown", "the new text ends with a backslash")
            out.append(new[at])
            at += 1
        elif character == "$":
            group, at = _group(new, at, match)
            out.append(group or "")
        else:
            out.append(character)
    return "".join(out)


def _group(new: str, at: int, match: re.Match[str]) -> tuple[Any, int]:
    """The group named after a ``$`` and the position after it. Digits are read while such a group exists."""
    if new.startswith("{", at) and "}" in new[at:]:
        end = new.index("}", at)
        try:
            return match.group(new[at + 1 : end]), end + 1
        except IndexError:
            raise Failed("unknown", f"the pattern has no group {new[at + 1 : end]}") from None
    if not new[at : at + 1].isdigit():
        raise Failed("unknown", "a $ in the new text is followed by the number of a group")
    number, at = int(new[at]), at + 1
    groups = match.re.groups
    if number > groups:
        raise Failed("unknown", f"the pattern has no group {number}")
    while new[at : at + 1].isdigit() and number * 10 + int(new[at]) <= groups:
        number, at = number * 10 + int(new[at]), at + 1
    return match.group(number), at
