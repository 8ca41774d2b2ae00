"""A place in a text where parsing does not go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from agentd.language.lexer import Tokens
from agentd.language.source import Source


@dataclass(frozen=True, slots=True)
class Place:
    """The token that cannot stand where it does, and those around it."""

    source: Source
    tokens: Tokens
    index: int
    expected: Mapping[str, int]

    @property
    def kind(self) -> str:
        return self.tokens.types[self.index]

    @property
    def text(self) -> str:
        return self.tokens.texts[self.index]

    @property
    def before(self) -> str:
        """The text of the token before; empty at the beginning."""
        return self.tokens.texts[self.index - 1] if self.index else ""

    @property
    def kind_before(self) -> str:
        return self.tokens.types[self.index - 1] if self.index else ""

    @property
    def after(self) -> str:
        return self.tokens.texts[self.index + 1] if self.index + 1 < len(self.tokens.texts) else ""

    @property
    def adjoins(self) -> bool:
        """Whether no blank stands between the token and the one before it."""
        starts = self.tokens.starts
        return self.index > 0 and starts[self.index] == starts[self.index - 1] + len(self.before)

    @property
    def begins_line(self) -> bool:
        return self.index in self.tokens.first_in_line

    @property
    def found(self) -> str:
        return f"'{self.text}'" if self.text else "the end of the text"
