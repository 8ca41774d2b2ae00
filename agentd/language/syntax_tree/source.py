"""A source text, with conversion of offsets to lines and columns."""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path

from agentd.language.syntax_tree.nodes import Position
from schemas.files.text_files import read_bounded


class Source:
    """A text under the name that its user knows it by. Offsets count characters from 0, lines and columns from 1.

    `at`: where all of it is in that file, for a text in a value of another format.
    """

    __slots__ = ("_at", "_starts", "file", "text")

    def __init__(self, text: str, file: str, at: tuple[int, int] | None = None) -> None:
        self.text = text
        self.file = file
        self._at = at
        self._starts: list[int] | None = None

    def place(self, offset: int) -> tuple[int, int]:
        """Line and column of an offset."""
        if self._at is not None:
            return self._at
        starts = self._line_starts()
        line = bisect_right(starts, offset)
        return line, offset - starts[line - 1] + 1

    def position(self, offset: int) -> Position:
        """Return line and column of an offset, from 0."""
        return Position(self.file, *self.place(offset))

    def line(self, number: int) -> str:
        """Return the text of line ``number`` (from 1), tabs as single blanks to keep columns; empty beyond the end."""
        starts = self._line_starts()
        if not 1 <= number <= len(starts):
            return ""
        end = starts[number] if number < len(starts) else len(self.text)
        return self.text[starts[number - 1] : end].rstrip("\r\n").replace("\t", " ")

    def _line_starts(self) -> list[int]:
        if self._starts is None:
            starts = [0]
            at = self.text.find("\n")
            while at >= 0:
                starts.append(at + 1)
                at = self.text.find("\n", at + 1)
            self._starts = starts
        return self._starts


def read_source(path: str | Path) -> Source:
    """Read a file of AgentSpeak. Raises OSError as ``open`` does, and UnicodeDecodeError when it is not UTF-8 text."""
    return Source(read_bounded(path).decode("utf-8-sig"), str(path))
