"""Rows of text for the panes, and tables of them that fit a width."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich.cells import cell_len
from rich.text import Text

from schemas.humanize import printable

HEAD, DIM, BAD, WARN, GOOD = "bold dim", "dim", "bold red", "yellow", "green"
GAP = 2
"""Columns between two cells."""
_FOLDERS = re.compile(r"[^\s(,]*/(?=[^\s/(,]+:\d)")
_LONG = re.compile(r"(\.\d{6})\d+")


@dataclass(frozen=True)
class Row:
    """One row of a pane."""

    text: Text
    key: str = ""
    """Identity of a row that can be chosen: `agent scout`."""
    indent: int = 0
    """Columns by which wrapped lines are indented."""
    head: bool = False
    """Whether it is a heading, which no filter hides."""
    found_by: str = field(default="", compare=False)
    """Further words by which a filter finds it."""

    def __post_init__(self) -> None:
        """Remove control characters from the text, whoever made it."""
        safe(self.text)

    def matches(self, words: Sequence[str]) -> bool:
        """Whether the row has every word, and none with a `-` before it. The words are in lower case."""
        text = f"{self.text.plain} {self.found_by}".lower()
        return all(word[1:] not in text if word[:1] == "-" and word[1:] else word in text for word in words)


def safe(text: Text) -> Text:
    """Replace each control character of a text by a blank; its styles stay."""
    if not text.plain.isprintable():
        text.plain = printable(text.plain)
    return text


def safe_text(text: str, style: str = "") -> Text:
    """Return a text without control characters."""
    return Text(printable(text), style)


def head(text: str) -> Row:
    """Return a heading."""
    return Row(Text(text.upper(), HEAD), head=True)


def joined(*parts: Text | str | tuple[str, str], gap: str = "  ") -> Text:
    """Join parts in a line; empty ones are left out."""
    text = Text()
    for part in parts:
        one = safe_text(part) if isinstance(part, str) else safe_text(*part) if isinstance(part, tuple) else part
        if one.plain:
            text.append(gap if text.plain else "").append_text(one)
    return text


def table(rows: Sequence[Sequence[Text]], width: int, *, flex: int, right: Sequence[int] = ()) -> list[Text]:
    """Return rows as lines of `width` columns, cells aligned; cell `flex` gets the remaining width.

    `right`: cells that are aligned at their right end.

    Columns at the right end go first where there is no room, and an empty column takes none.
    """
    if not rows:
        return []
    count = max(map(len, rows))
    widths = [max((cell_len(row[at].plain) if at < len(row) else 0) for row in rows) for at in range(count)]
    least = min(widths[flex], 12)
    while (
        count > flex + 1
        and sum(GAP + one for at, one in enumerate(widths[:count]) if one and at != flex) + least > width
    ):
        count -= 1
    others = sum(GAP + one for at, one in enumerate(widths[:count]) if one and at != flex)
    widths[flex] = max(least, min(widths[flex], width - others))
    return [_line(row[:count], widths, right) for row in rows]


def _line(row: Sequence[Text], widths: Sequence[int], right: Sequence[int]) -> Text:
    text = Text(no_wrap=True)
    for at, cell in enumerate(row):
        if not widths[at]:
            continue
        one = cell.copy()
        if at in right:
            one.align("right", widths[at])
        else:
            one.truncate(widths[at], overflow="ellipsis", pad=True)
        text.append_text(one)
        text.append(" " * GAP)
    text.rstrip()
    return text


def place(position: str) -> str:
    """Return `file:line` without the folders."""
    return position.rpartition("/")[2]


def rounded(text: str) -> str:
    """Return a text whose numbers have at most six decimals: degrees to 0.1 m."""
    return _LONG.sub(r"\1", text)


def places(text: str) -> str:
    """Return a text whose `file:line` have no folders."""
    return _FOLDERS.sub("", text)


@dataclass(frozen=True)
class Glyphs:
    """One set of marks."""

    well: str = "●"
    away: str = "○"
    runs: str = "▸"
    under: str = "‹"
    """Between a goal and the one that waits for it."""
    cursor: str = "▌"
    instead: Mapping[int, str] = field(default_factory=dict)
    """Replacements for characters that this terminal does not have."""


UNICODE = Glyphs()
ASCII = Glyphs("*", "o", ">", "<", ">", {ord("→"): ">", ord("←"): "<", ord("…"): "~"})


def glyphs_of(environment: Mapping[str, str], encoding: str) -> Glyphs:
    """Return the marks that a terminal can show."""
    plain = environment.get("TERM", "") in ("linux", "vt100", "vt102", "vt220", "ansi", "dumb")
    return UNICODE if not plain and encoding.lower().replace("-", "") == "utf8" else ASCII
