"""Texts for people: lengths of time, sizes, counts, lists, columns, JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Container, Sequence

from schemas.files.terminal import printable

LONGEST = 500
"""Characters of a text that `shortened` leaves, unless another number is given."""


def shortened(text: str, at_most: int = LONGEST) -> str:
    """Return one line of at most `at_most` characters, which no terminal takes for a command."""
    line = printable(text)
    return line if len(line) <= at_most else f"{line[: at_most - 1]}…"


def count(number: int, noun: str, plural: str = "") -> str:
    """Return `1 message`, `2 messages`; `plural` is for a noun that does not just take an `s`."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def joined(parts: Sequence[str], last: str = "and") -> str:
    """Return `a, b and c`."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}" if parts else ""


def span(seconds: float) -> str:
    """Return a length of time: `0.4 s`, `95 s`, `3 min 5 s`, `2 h 5 min`, `3 d 2 h`; `? s` if it is not finite."""
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
    """Return a delay: `12.3 ms`, from 0.1 s on as `span`."""
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
    """Return each row as one line, with its cells below those of the others; those of the columns `right` flush right.

    All rows have as many cells.
    """
    widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]

    def cell(place: int, text: str) -> str:
        return text.rjust(widths[place]) if place in right else text.ljust(widths[place])

    return ["  ".join(map(cell, range(len(row)), row)).rstrip() for row in rows]


def json_lines(value: object, indent: int | None = 2) -> str:
    """Return a value as JSON for people and programs, of which no terminal takes anything for a command."""
    return "\n".join(map(escaped, json.dumps(value, ensure_ascii=False, indent=indent).split("\n")))


def escaped(text: str) -> str:
    """Return a text with `\\uXXXX` in place of what a terminal may take for a command; JSON stays the same JSON."""
    return text if text.isprintable() else "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)
