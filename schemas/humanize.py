"""Texts for people: lengths of time, sizes, counts, lists, columns, JSON; and text of others, escaped for terminals."""

from __future__ import annotations

import json
import math
from collections.abc import Container, Sequence

LONGEST = 500
"""Default length of `shortened`, in characters."""


def shortened(text: str, at_most: int = LONGEST) -> str:
    """Return one line of at most `at_most` characters without terminal commands."""
    line = printable(text)
    return line if len(line) <= at_most else f"{line[: at_most - 1]}…"


def count(number: int, noun: str, plural: str = "") -> str:
    """Return `1 message`, `2 messages`; `plural` is for irregular nouns."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def joined(parts: Sequence[str], last: str = "and") -> str:
    """Return `a, b and c`."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}" if parts else ""


def some(parts: Sequence[str], most: int) -> str:
    """Return `a, b and c`, of more than `most` (1 or more) the first, and how many more there are."""
    return joined([*parts[:most], f"{len(parts) - most} more"] if len(parts) > most else parts)


def span(seconds: float) -> str:
    """Return a length of time in seconds: `0.4 s`, `95 s`, `3 min 5 s`, `2 h 5 min`, `3 d 2 h`; `? s` if not finite."""
    if not math.isfinite(seconds):
        return "? s"
    if seconds < 9.95:
        return f"{max(0.0, seconds):.1f} s"
    if seconds < 119.5:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s".removesuffix(" 0 s")
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min".removesuffix(" 0 min") if hours < 48 else f"{hours // 24} d {hours % 24} h"


def latency(seconds: float) -> str:
    """Return a delay in seconds: `12.3 ms`, from 0.1 s on as `span`."""
    return f"{seconds * 1000:.1f} ms" if seconds < 0.0995 else span(seconds)


def size(number: int) -> str:
    """Return a number of bytes: `64 B`, `1.5 kB`, `2.0 GB`."""
    if number < 1000:
        return f"{number} B"
    for unit, factor in (("kB", 1e3), ("MB", 1e6)):
        if number < 1000 * factor:
            return f"{number / factor:.1f} {unit}"
    return f"{number / 1e9:.1f} GB"


def columns(rows: Sequence[Sequence[str]], right: Container[int] = ()) -> list[str]:
    """Return each row as a line of aligned columns, the columns `right` flush right. All rows have the same length."""
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]

    def cell(place: int, text: str) -> str:
        return text.rjust(widths[place]) if place in right else text.ljust(widths[place])

    return ["  ".join(map(cell, range(len(row)), row)).rstrip() for row in rows]


def json_lines(value: object, indent: int | None = 2) -> str:
    """Return a value as JSON without terminal commands; `indent`: blanks per level, None = on one line."""
    return "\n".join(map(escaped, json.dumps(value, ensure_ascii=False, indent=indent).split("\n")))


def escaped(text: str) -> str:
    """Return a JSON text with `\\uXXXX` for each character that a terminal may interpret."""
    return text if text.isprintable() else "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


_DIRECTIONS = (0x061C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
"""Marks that change the direction of writing, by which a text can look like another."""
_CONTROLS = {code: repr(chr(code))[1:-1] for code in (*range(32), *range(127, 160), 0x2028, 0x2029, *_DIRECTIONS)}
_KEPT = {code: text for code, text in _CONTROLS.items() if chr(code) not in "\n\t"}


def escape_line(text: str) -> str:
    """Return a text as one line of Unicode, with `\\x1b` or the like in place of each control character."""
    return _escaped(text, _CONTROLS)


def escape_lines(text: str) -> str:
    """Return `escape_line` of a text, but keep line breaks and tabs."""
    return _escaped(text, _KEPT)


def printable(text: str) -> str:
    """Return a text with a blank for each character that is not printable."""
    return text if text.isprintable() else "".join(char if char.isprintable() else " " for char in text)


def _escaped(text: str, controls: dict[int, str]) -> str:
    if text.isprintable():
        return text
    return text.translate(controls).encode("utf-8", "backslashreplace").decode()  # half a surrogate pair is no UTF-8
