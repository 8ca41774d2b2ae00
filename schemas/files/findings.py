"""Findings about users' files: file, line, column and what was expected, one line each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from schemas.humanize import escape_line

CLOSE = 0.6
"""The least similarity of two names by `difflib`, from 0 to 1, at which one is probably the other."""


@dataclass(frozen=True, order=True)
class Finding:
    """One problem in a file. `line` and `column` count from 1; 0 = the file as a whole."""

    file: str
    line: int
    column: int
    message: str
    severity: Literal["error", "warning", "info"] = "error"
    """`info`: nothing is wrong, but something could not be checked."""
    kind: str = ""
    """The kind of problem, for tools; empty where there is no list of kinds."""

    def __str__(self) -> str:
        where = self.file
        if self.line:
            where += f":{self.line}"
            if self.column:
                where += f":{self.column}"
        return escape_line(f"{where}: {self.severity}: {self.message}")


class Findings(Exception):
    """All findings about a file; `str` has one line for each, in the order of the file."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        self.findings = sorted(findings)
        super().__init__("\n".join(map(str, self.findings)))

    @classmethod
    def about(cls, file: str | Path, message: str) -> Findings:
        """Return one error that is about a file as a whole."""
        return cls([Finding(str(file), 0, 0, message)])


def nearest(word: str, known: Iterable[str], close: float = CLOSE) -> str | None:
    """Return the known name that a word probably means: a near miss, or the same name in a namespace.

    None if there is no such name, and for a known word: it is not misspelt.
    """
    import difflib  # not needed for files without mistakes

    names = sorted(known)
    if word in names:
        return None
    found = [name for name in names if name.endswith(f"::{word}")] or difflib.get_close_matches(word, names, 1, close)
    return found[0] if found else None


def near_miss(word: str, known: Iterable[str], close: float = CLOSE, suffix: str = "") -> str:
    """Return `, did you mean `x`?` for a near miss (`nearest`), else an empty text. `suffix`: the end of x."""
    near = nearest(word, known, close)
    return "" if near is None else f", did you mean `{near}{suffix}`?"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `, did you mean `x`?` for a near miss, else the list of known names."""
    names = sorted(known)
    return near_miss(word, names) or (f"; known are {', '.join(names)}" if names else "")
