"""Syntax errors: each with its place, its line and a caret."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from msgspec import Struct

from agentd.language.syntax_tree.source import Source
from schemas.files.findings import Finding, near_miss
from schemas.humanize import escape_lines

if TYPE_CHECKING:
    from agentd.language.syntax_tree.nodes import Program

SYNTAX = "syntax"
"""The kind of these findings."""

CLOSE = 0.7
"""The least similarity of two names in a program (`nearest`): a letter or two wrong or missing in a short one."""
_WIDTH = 110
"""Characters of a source line that are shown."""


_LONGEST = 40
"""Characters of a token that a message shows."""


def shown(text: str) -> str:
    """Return a token as a message shows it: in one line, and not all of a very long one."""
    text = text.replace("\n", "\\n")
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def near(word: str, known: Iterable[str]) -> str:
    """Return the hint of `near_miss` for a word of a program that is probably misspelt, else nothing."""
    return near_miss(word, known, CLOSE)


class Problem(Struct, frozen=True, order=True):
    """A finding with the source line that it is about; ``caret`` is the column under which the mark goes (0: none)."""

    finding: Finding
    excerpt: str
    caret: int

    def __str__(self) -> str:
        lines = [str(self.finding)]
        if self.excerpt:
            excerpt, caret = self._clipped()
            lines.append(f"    {excerpt}")
            if caret:
                lines.append(" " * (4 + caret - 1) + "^")
        return escape_lines("\n".join(lines))

    def _clipped(self) -> tuple[str, int]:
        """Return the excerpt and caret, of a very long line only what is around the caret."""
        if len(self.excerpt) <= _WIDTH:
            return self.excerpt, self.caret
        begin = max(0, min(self.caret - _WIDTH // 2, len(self.excerpt) - _WIDTH))
        before, after = "..." * (begin > 0), "..." * (begin + _WIDTH < len(self.excerpt))
        caret = self.caret - begin + len(before) if self.caret else 0
        return before + self.excerpt[begin : begin + _WIDTH] + after, caret


class SyntaxErrors(ValueError):
    """Everything that is wrong with a text, in its order; ``str`` shows each with its line and a caret."""

    def __init__(self, problems: Iterable[Problem], rest: Program | None = None) -> None:
        """`rest`: what could be read of a program."""
        self.problems, self.rest = tuple(sorted(problems)), rest
        super().__init__("\n".join(map(str, self.problems)))

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The problems as findings."""
        return tuple(problem.finding for problem in self.problems)


def problem_at(source: Source, offset: int, message: str) -> Problem:
    """Return an error at ``offset``, an index of the source's text."""
    return problem_on(source, *source.place(offset), message)


def problem_on(source: Source, line: int, column: int, message: str) -> Problem:
    """Return an error at a `line` and `column` (both from 1) of a source."""
    return Problem(Finding(source.file, line, column, message, kind=SYNTAX), source.line(line), column)
