"""A place in a text where parsing does not go on."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from agentd.language.parser.lalr import machine
from agentd.language.parser.lexer import Tokens
from agentd.language.syntax_tree.errors import shown
from agentd.language.syntax_tree.source import Source

CLOSERS: Final = {"(": ")", "[": "]", "{": "}"}
SIGNS: Final = frozenset("+-^")

SIGN_CHARACTERS: Final = frozenset("=<>!\\~/:+*&|-%^")
"""What the signs of this and other languages are made of."""

_PART_AFTER: Final = {
    "ARROW": "body",
    "arrow": "body",
    "_details": "body",
    "COLON": "context",
    "context": "context",
    "UNTIL": "context",
    "condition": "context",
    "_conditions": "context",
    "RULE_ARROW": "rule",
}
_SIGN_TYPES: Final = frozenset(("PLUS", "MINUS", "CARET", "trigger", "goal_trigger", "belief_trigger"))
_ITEMS: Final = frozenset(("", "LBRACE", "belief", "rule", "goal", "plan", "subplans", "directive", "item"))

END_TERM: Final = frozenset(
    ("NAME", "QUOTED", "INTERNAL", "VARIABLE", "NUMBER", "STRING", "TRUE", "FALSE", "RPAR", "RSQB", "RBRACE")
)
"""The tokens that a term can end with."""

BEGIN_TERM: Final = frozenset(
    ("NAME", "QUOTED", "INTERNAL", "VARIABLE", "NUMBER", "STRING", "TRUE", "FALSE", "LPAR", "LSQB", "TILDE")
)
"""The tokens that a term can begin with and that cannot go on with one."""


@dataclass(frozen=True)
class ErrorContext:
    """The token that is not allowed, and the tokens around it.

    ``states`` and ``offsets`` are those of the parser: what it has read and not yet reduced, and where that begins.
    ``expected`` are the types of the tokens that it would go on with.
    """

    source: Source
    tokens: Tokens
    index: int
    states: Sequence[int]
    offsets: Sequence[int]

    @cached_property
    def expected(self) -> frozenset[str]:
        """The types of tokens that could follow."""
        return machine().accepted(self.states)

    @property
    def text(self) -> str:
        """The source."""
        return self.tokens.texts[self.index]

    @property
    def before(self) -> str:
        """The text of the token before; empty at the beginning."""
        return self.tokens.texts[self.index - 1] if self.index else ""

    @property
    def found(self) -> str:
        """The token at the error as text."""
        return f"'{shown(self.text)}'" if self.text else "the end of the text"

    @cached_property
    def signs(self) -> str:
        """The signs in a row around a token that is a sign; empty for another token."""
        return sign_at(self.source.text, self.tokens.starts[self.index]) if self.text[:1] in SIGN_CHARACTERS else ""

    def adjoins(self, index: int) -> bool:
        """Return whether there is no blank between the token at ``index`` and the one before it."""
        starts = self.tokens.starts
        return index > 0 and starts[index] == starts[index - 1] + len(self.tokens.texts[index - 1])

    def _begins_plan(self, index: int) -> bool:
        """Return whether the token is a label, or the sign of a goal's trigger."""
        text, after = self.tokens.texts[index], "".join(self.tokens.texts[index + 1 : index + 2])
        return text == "@" or (text in SIGNS and after in ("!", "?"))

    @property
    def opened(self) -> int | None:
        """The index of the innermost bracket that is open before the token, in its item."""
        return self._surroundings[0]

    @property
    def part(self) -> str:
        """What the token is part of: ``body``, ``context``, ``rule``, ``label``, ``trigger``, ``goal``, ``belief``.

        Or ``braces`` without a part of a plan in them, or ``start`` where an item begins.
        """
        return self._surroundings[1]

    @cached_property
    def open_around(self) -> frozenset[str]:
        """The names of what is open around the token, as ``syntax_errors.txt`` has them."""
        if self.opened is None:
            return frozenset(("top", "block"))
        texts, types = self.tokens.texts, self.tokens.types
        before = self.opened - 1
        match texts[self.opened]:
            case "[":
                return frozenset(("open", "list"))
            case "(" if before >= 0 and types[before] in ("NAME", "QUOTED", "INTERNAL"):
                return frozenset(("open", "round", "arguments"))
            case "(":
                word = texts[before] if before >= 0 else ""
                group = self.part == "body" and word in ("<-", ";", "{", "|&|", "|||")
                kinds = ("open", "round", "condition", "for" * (word == "for"), "group" * group)
                return frozenset(filter(None, kinds))
        if before >= 0 and types[before] == "_END":
            return frozenset(("block", "subplans"))
        plan, closed = self._begins_plan(self.opened + 1), self.text == "." and self._closed_later()
        return frozenset(filter(None, ("block", "brace", "plan" * plan, "closed" * closed)))

    def _closed_later(self) -> bool:
        """Return whether the innermost brace is closed before another plan begins."""
        depth = 1
        texts = self.tokens.texts
        for index in range(self.index + 1, len(texts)):
            depth += (texts[index] == "{") - (texts[index] == "}")
            if not depth:
                return True
            if self._begins_plan(index) and index in self.tokens.first_in_line:
                return False
        return False

    @cached_property
    def _surroundings(self) -> tuple[int | None, str]:
        """The innermost open bracket and the part, by what is on the parser's stack from the last item on."""
        entered_by = machine().entered_by
        symbols = [entered_by.get(state, "") for state in self.states]
        opened: int | None = None
        part, closed, index = "", 0, len(symbols) - 1
        while index and not (symbols[index].startswith("__program_star") or (symbols[index] == "_END" and not closed)):
            symbol = symbols[index]
            closed += symbol in ("RPAR", "RSQB", "RBRACE")
            if closed:
                closed -= symbol in ("LPAR", "LSQB", "LBRACE")
            elif symbol in ("LPAR", "LSQB", "LBRACE"):
                opened = bisect_left(self.tokens.starts, self.offsets[index]) if opened is None else opened
                if symbol == "LBRACE":
                    return opened, part or ("braces" if self._holds_code(opened) else "body")
            else:
                part = part or _PART_AFTER.get(symbol, "")
            index -= 1
        return opened, part or _part_of_head(symbols[index + 1 :])

    def _holds_code(self, index: int) -> bool:
        """Return whether a brace holds a plan, trigger or rule as a term, or a directive, not the body of a block."""
        begins_item = index == 0 or self.tokens.types[index - 1] in ("_END", "RBRACE")
        return begins_item or self._begins_plan(index + 1)

    def ends_gap(self, index: int, gap: str) -> bool:
        """Return whether the ``..`` or ``...`` of a pattern reaches no further back than the token at ``index``."""
        if gap == ".." and (index in self.tokens.first_in_line or self.tokens.texts[index] == "<-"):
            return True
        return self.tokens.types[index] == "_END"

    def opened_at(self) -> str:
        """``'(' of line 1, column 9``: the innermost open bracket and its place."""
        assert self.opened is not None
        line, column = self.source.place(self.tokens.starts[self.opened])
        return f"'{self.tokens.texts[self.opened]}' of line {line}, column {column}"


def sign_at(text: str, at: int) -> str:
    """Return all signs in a row around an offset ``at``, from 0 on, at most four on each side."""
    begin = end = at
    while begin and text[begin - 1] in SIGN_CHARACTERS and at - begin < 4:
        begin -= 1
    while end < len(text) and text[end] in SIGN_CHARACTERS and end - at < 4:
        end += 1
    return text[begin:end]


def _part_of_head(symbols: Sequence[str]) -> str:
    """Return the part of an item that has got no further than its head, by what has been read of it."""
    first = symbols[0] if symbols else ""
    if first in ("AT", "label"):
        return "trigger" if _SIGN_TYPES.intersection(symbols) else "label"
    if first in _SIGN_TYPES:
        return "trigger"
    if first in ("BANG", "QUERY"):
        return "goal"
    return "start" if first in _ITEMS else "belief"
