"""The texts that a program was read from, so that it can be read again when the files have changed or are elsewhere."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from agentd.language.parse import parse_program, parse_source
from agentd.language.syntax_tree.nodes import Program
from agentd.language.syntax_tree.source import Source, read_source


@lru_cache(maxsize=256)
def _packed(text: str) -> bytes:
    """A text as it is kept; agents of one process that run the same program keep it once."""
    return zlib.compress(text.encode(), 6)


@dataclass(slots=True)
class Sources:
    """What an agent's program is made of: files, and what the mission file says besides."""

    main: str = ""
    """The path of the main file, as it was read; empty: there is none."""
    mission: str = ""
    """The path of the mission file, which positions name."""
    beliefs: tuple[str, ...] = ()
    """Of the mission file, as it has them."""
    goals: tuple[str, ...] = ()
    on_restart: str = ""
    """The goal that takes the place of what a restarted agent had in mind; empty if there is none."""
    formulas: tuple[str, ...] = ()
    """The mission's `done` and `failed` formulas of this agent."""
    _packed: dict[str, bytes] = field(default_factory=dict)

    def parse_file(self, path: str | Path) -> Program:
        """As `agentd.language.parse.parse_file`, and keep the text."""
        return parse_source(lambda: self._read(path), path)

    def _read(self, path: str | Path) -> Source:
        source = read_source(path)
        self.keep(str(path), source.text)
        return source

    def keep(self, path: str, text: str) -> None:
        """Keep the text that was read from a path."""
        self._packed[path] = _packed(text)

    @property
    def files(self) -> dict[str, str]:
        """The texts by their paths."""
        return {path: zlib.decompress(packed).decode() for path, packed in self._packed.items()}


class Texts:
    """Reads programs from texts."""

    def __init__(self, files: Mapping[str, str]) -> None:
        self._files = files

    def parse_file(self, path: str | Path) -> Program:
        """As `agentd.language.parse.parse_file`. Raises FileNotFoundError for a file that is not among the
        texts."""
        text = self._files.get(str(path))
        if text is None:
            raise FileNotFoundError(2, "it is not in the recording", str(path))
        return parse_program(text, str(path))
