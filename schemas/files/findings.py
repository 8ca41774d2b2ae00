"""Findings about users' files: file, line, column and what was expected, one line each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from schemas.humanize import escape_line


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


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `, did you mean `x`?` for a near miss, else the list of known names."""
    import difflib  # not needed for files without mistakes

    names = sorted(known)
    if near := difflib.get_close_matches(word, names, 1, 0.6):
        return f", did you mean `{near[0]}`?"
    return f"; known are {', '.join(names)}" if names else ""
