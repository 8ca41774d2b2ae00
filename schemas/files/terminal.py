"""Escapes the text of others where it is shown: no terminal and no log takes any of it for a command."""

from __future__ import annotations

_DIRECTIONS = (0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
"""Marks that turn the direction of writing: what follows them looks like another text."""
_CONTROLS = {code: repr(chr(code))[1:-1] for code in (*range(32), *range(127, 160), 0x2028, 0x2029, *_DIRECTIONS)}
_KEPT = {code: text for code, text in _CONTROLS.items() if chr(code) not in "\n\t"}


def escape_line(text: str) -> str:
    """Return a text as one line of Unicode, with `\\x1b` or the like in place of each control character."""
    return _escaped(text, _CONTROLS)


def escape_lines(text: str) -> str:
    """`escape_line` that lets line breaks and tabs stay: for a person who reads one source alone."""
    return _escaped(text, _KEPT)


def printable(text: str) -> str:
    """Return one line that no terminal takes for a command: what vehicles and programs say is not trusted."""
    return "".join(char if char.isprintable() else " " for char in text)


def _escaped(text: str, controls: dict[int, str]) -> str:
    if text.isprintable():
        return text
    return text.translate(controls).encode("utf-8", "backslashreplace").decode()  # half a surrogate pair is no UTF-8
