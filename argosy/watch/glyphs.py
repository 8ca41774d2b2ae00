"""The marks of the view, for terminals that have them and for those that have only ASCII, such as the Linux console."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


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
    """What is written for marks in texts that this terminal does not have."""


UNICODE = Glyphs()
ASCII = Glyphs("*", "o", ">", "<", ">", {ord("→"): ">", ord("←"): "<", ord("…"): "~"})


def glyphs_of(environment: Mapping[str, str], encoding: str) -> Glyphs:
    """Return the marks that a terminal can show."""
    plain = environment.get("TERM", "") in ("linux", "vt100", "vt102", "vt220", "ansi", "dumb")
    return UNICODE if not plain and encoding.lower().replace("-", "") == "utf8" else ASCII
