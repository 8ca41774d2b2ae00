"""What the parser refuses, told so that the author of the program can mend it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from agentd.language.source import Source
from schemas.findings import Finding


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """A finding with the source line that it is about; ``caret`` is the column under which the mark goes (0: none)."""

    finding: Finding
    excerpt: str
    caret: int

    def __str__(self) -> str:
        lines = [str(self.finding)]
        if self.excerpt:
            lines.append(f"    {self.excerpt}")
            if self.caret:
                lines.append(" " * (4 + self.caret - 1) + "^")
        return "\n".join(lines)


class SyntaxErrors(ValueError):
    """Everything that is wrong with a text, in its order; ``str`` shows each with its line and a caret."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(sorted(problems))
        super().__init__("\n".join(map(str, self.problems)))

    @property
    def findings(self) -> tuple[Finding, ...]:
        return tuple(problem.finding for problem in self.problems)


def problem_at(source: Source, offset: int, message: str) -> Problem:
    """An error at an offset of a source."""
    return problem_on(source, *source.place(offset), message)


def problem_on(source: Source, line: int, column: int, message: str) -> Problem:
    """An error at a line and column of a source."""
    return Problem(Finding(source.file, line, column, message), source.line(line), column)
