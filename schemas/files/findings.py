"""What is wrong with a user's file, where, and what was expected: one line each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from schemas.files.terminal import escape_line


@dataclass(frozen=True, order=True)
class Finding:
    """One problem in a file. `line` and `column` count from 1; 0 = the file as a whole."""

    file: str
    line: int
    column: int
    message: str
    severity: Literal["error", "warning", "info"] = "error"
    """`info` is nothing that is wrong, but what could not be looked at."""
    kind: str = ""
    """What sort of problem it is, for tools; empty where there is no list of kinds."""

    def __str__(self) -> str:
        where = self.file
        if self.line:
            where += f":{self.line}"
            if self.column:
                where += f":{self.column}"
        return escape_line(f"{where}: {self.severity}: {self.message}")


class Findings(Exception):
    """All problems that reading a file has found; `str` is one line each, in the order of the file."""

    def __init__(self, findings: Iterable[Finding]) -> None:
        self.findings = sorted(findings)
        super().__init__("\n".join(map(str, self.findings)))
