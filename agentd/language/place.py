"""A place in a text where parsing does not go on."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from agentd.language.errors import shown
from agentd.language.lexer import END_OF_TEXT, Tokens
from agentd.language.source import Source

CLOSERS: Final = {"(": ")", "[": "]", "{": "}"}
SIGNS: Final = frozenset("+-^")

BLOCKS: Final = frozenset(("if", "while", "for", "elif"))
"""The words that a condition in brackets and a block in braces follow."""

_PART_AFTER: Final = {"<-": "body", ":": "context", "<:": "context", ":-": "rule"}
_PART_FROM: Final = {"@": "label", "+": "trigger", "-": "trigger", "^": "trigger", "!": "goal", "?": "goal"}

END_TERM: Final = frozenset(
    ("NAME", "QUOTED", "INTERNAL", "VARIABLE", "NUMBER", "STRING", "TRUE", "FALSE", "RPAR", "RSQB", "RBRACE")
)
"""The tokens that a term can end with."""

BEGIN_TERM: Final = frozenset(
    ("NAME", "QUOTED", "INTERNAL", "VARIABLE", "NUMBER", "STRING", "TRUE", "FALSE", "LPAR", "LSQB", "TILDE")
)
"""The tokens that a term can begin with and that cannot go on with one."""


@dataclass(frozen=True)
class Place:
    """The token that cannot stand where it does, and those around it; ``expected`` are the types of what could."""

    source: Source
    tokens: Tokens
    index: int
    expected: Collection[str]

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
        return self.text_at(self.index + 1)

    def text_at(self, index: int) -> str:
        """The text of a token; empty outside the text."""
        return self.tokens.texts[index] if 0 <= index < len(self.tokens.texts) else ""

    @property
    def adjoins(self) -> bool:
        """Whether no blank stands between the token and the one before it."""
        starts = self.tokens.starts
        return self.index > 0 and starts[self.index] == starts[self.index - 1] + len(self.before)

    @property
    def begins_line(self) -> bool:
        return self.index in self.tokens.first_in_line

    @property
    def ends_line(self) -> bool:
        """Whether the token is the last of its line."""
        after = self.index + 1
        return after >= len(self.tokens.types) or after in self.tokens.first_in_line or self._ends_text(after)

    def _ends_text(self, index: int) -> bool:
        return self.tokens.types[index] == END_OF_TEXT

    @property
    def found(self) -> str:
        return f"'{shown(self.text)}'" if self.text else "the end of the text"

    @property
    def follows_term(self) -> bool:
        """Whether the token before ends a term."""
        return self.kind_before in END_TERM

    def begins_plan(self, index: int) -> bool:
        """Whether a label, or the sign of a goal's trigger, stands there."""
        text = self.text_at(index)
        return text == "@" or (text in SIGNS and self.text_at(index + 1) in ("!", "?"))

    @property
    def opened(self) -> int | None:
        """The index of the innermost bracket that is open before the token, in its item."""
        return self._surroundings[0]

    @property
    def bracket(self) -> str:
        """That bracket; empty when none is open."""
        return "" if self.opened is None else self.tokens.texts[self.opened]

    @property
    def part(self) -> str:
        """What the token is part of: ``body``, ``context``, ``rule``, ``label``, ``trigger``, ``goal``, ``belief``.

        Or ``braces`` without a part of a plan in them, or ``""`` where an item begins.
        """
        return self._surroundings[1]

    @cached_property
    def _surroundings(self) -> tuple[int | None, str]:
        opened: int | None = None
        closers, closed = 0, 0
        texts, types = self.tokens.texts, self.tokens.types
        index = self.index - 1
        while index >= 0:
            text = texts[index]
            if text in (")", "]", "}"):
                closed = closed if closers else index
                closers += 1
            elif text in CLOSERS:
                if closers:
                    closers -= 1
                    if not closers and text == "{" and opened is None and self._begins_item(index):
                        index = closed  # the end of a directive or of sub-plans
                        break
                else:
                    opened = index if opened is None else opened
                    if text == "{":
                        return opened, "braces" if self._holds_code(index) else "body"
            elif not closers and text in _PART_AFTER:
                return self._opened_from(index, opened), _PART_AFTER[text]
            elif not closers and types[index] == "_END":
                break
            index -= 1
        return opened, _PART_FROM.get(texts[index + 1], "belief") if index + 1 < self.index else ""

    def _opened_from(self, index: int, opened: int | None) -> int | None:
        """The innermost open bracket when none was found as far back as ``index``: one may still be before it."""
        if opened is not None:
            return opened
        closers = 0
        texts, types = self.tokens.texts, self.tokens.types
        for at in range(index, -1, -1):
            if texts[at] in (")", "]", "}"):
                closers += 1
            elif texts[at] in CLOSERS:
                if not closers:
                    return at
                closers -= 1
            elif not closers and types[at] == "_END":
                break
        return None

    def _holds_code(self, index: int) -> bool:
        """Whether a brace holds a plan, trigger or rule as a term, or a directive, and not the body of a block."""
        return self.begins_plan(index + 1) or self._begins_item(index)

    def _begins_item(self, index: int) -> bool:
        """Whether a brace stands where a directive or sub-plans begin."""
        return index == 0 or self.tokens.types[index - 1] in ("_END", "RBRACE")

    def functor_before(self) -> int:
        """The index of the token before the bracketed arguments that end before the token; -1 if there is none."""
        index = self.index - 1
        if index >= 0 and self.tokens.texts[index] == ")":
            depth = 0
            while index >= 0:
                text = self.tokens.texts[index]
                depth += (text == ")") - (text == "(")
                index -= 1
                if depth == 0:
                    break
        return index

    def bracket_place(self) -> str:
        """``'(' of line 1, column 9``: the innermost open bracket, and where it stands."""
        assert self.opened is not None
        line, column = self.source.place(self.tokens.starts[self.opened])
        return f"'{self.bracket}' of line {line}, column {column}"
