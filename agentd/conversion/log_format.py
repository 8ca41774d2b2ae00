"""Format the notes of a mind: with an excerpt of the program, or in one line for a log."""

from __future__ import annotations

import linecache

from agentd.language.syntax_tree.errors import Problem
from agentd.language.syntax_tree.nodes import Position
from agentd.mind.data.effects import Log
from schemas.files.findings import Finding


def lines_of(note: Log) -> list[str]:
    """Return a note for people: text and position, the line of the program with a caret, then details."""
    return [
        f"{note.level}: {_where(note.at)}{note.text}",
        *_excerpt(note.at),
        *(f"    {line}" for line in note.details),
    ]


def line_of(note: Log) -> str:
    """Return a note in one line."""
    return _where(note.at) + "; ".join((note.text, *note.details))


def _where(at: Position | None) -> str:
    if at is None or not at.line:
        return ""
    return f"{at}: " if at.column else f"{at.file}:{at.line}: "


def _excerpt(at: Position | None) -> list[str]:
    """Return the line of a position with a caret, if its file can (still) be read."""
    if at is None or not at.line:
        return []
    linecache.checkcache(at.file)
    source = linecache.getline(at.file, at.line).rstrip("\r\n").replace("\t", " ")
    if not source.strip():
        return []
    indent = len(source) - len(source.lstrip())
    problem = Problem(Finding(at.file, at.line, at.column, ""), source[indent:], max(0, at.column - indent))
    return [f"  {line}" for line in str(problem).splitlines()[1:]]
