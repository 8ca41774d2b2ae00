"""Runs of ground facts in a large program: recognised by one regular expression each, read when they are needed.

A program of data is thousands of lines such as ``pos(17, 3.5, "text", [a,b]).`` The parser takes 80 µs for each and a
mind 50 µs; recognising one takes 4 µs, and its run-time term is read from the text. The syntax
of a fact is parsed on demand, together with the rest of its run.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import islice
from typing import Any, Final

from msgspec import Struct

from agentd.language.parser.build_terms import string_value
from agentd.language.parser.parse_tables import load
from agentd.language.syntax_tree.nodes import Belief, Item
from agentd.language.syntax_tree.signatures import signature
from agentd.language.syntax_tree.source import Source
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.terms import EMPTY, Literal, atom, make_list

LONGEST_RUN: Final = 1000
"""Facts of a run at most: all of a run are parsed together when the syntax of one is needed."""
DEEPEST: Final = 3
"""Brackets inside the brackets of a fact that is recognised; the parser reads those with more."""
MANY: Final = 150
"""Facts from which on compiling the expressions that recognise them (9 ms) costs less than parsing all of them."""
LARGE: Final = 200_000
"""Characters of a program whose parsing takes so long that compiling them does not count, if it has any facts."""
_FACT_FOLLOWS: Final = re.compile(r"\.(?:[ \t]*+//[^\n]{0,200})?+\s++[~a-z'/]")
"""The end of an item before one that may be a fact, or before a comment; in strings too: it only serves to estimate."""


class GroundFact(Belief):
    """A belief that is ground and computes nothing. Its syntax is parsed on the first use of it."""

    __slots__ = ("_end", "_run", "_start")

    def __init__(self, run: FactRun, start: int, end: int) -> None:
        self._run, self._start, self._end = run, start, end

    def __getattr__(self, name: str) -> Any:
        if name not in ("literal", "position"):
            raise AttributeError(name)
        self._run.parse()
        return getattr(self, name)

    def __repr__(self) -> str:
        """The tokens of the fact: the same for the same fact, and found without parsing it."""
        return f"GroundFact({' '.join(self._tokens())})"

    def _tokens(self) -> list[str]:
        found: list[str] = _recogniser().token.findall(self._run.source.text, self._start, self._end)
        return found

    def term(self) -> Literal:
        """Return the run-time term, as `agentd.language.terms.from_ast` makes it where no name in it is a function."""
        outer: list[tuple[list[Any], str]] = []
        terms: list[Any] = []
        for token in self._tokens():
            first = token[0]
            if first in _NUMERIC:
                terms.append(float(token))
            elif first == '"':
                terms.append(string_value(token))
            elif first == "[" or token[-1] == "(":
                outer.append((terms, token))
                terms = []
            elif first == "]" or first == ")":
                made = _compound(outer[-1][1], terms)
                terms, _ = outer.pop()
                terms.append(made)
            else:
                terms.append(_atom(token))
        fact: Literal = terms[0]
        if self._run.source.text[self._start] == "~" or len(terms) > 1:
            sig = signature(fact.sig.functor, len(fact.args), self._run.source.text[self._start] == "~")
            annots = sorted_annots(terms[1].items) if len(terms) > 1 else ()
            fact = Literal(sig, fact.args, annots)
        fact.ground = True
        return fact


_NUMERIC: Final = frozenset("-.0123456789")


def _compound(opening: str, terms: list[Any]) -> Any:
    """Return a list or structure of ground terms."""
    if opening == "[":
        if not terms:
            return EMPTY
        made: Any = make_list(terms)
    else:
        made = Literal(signature(opening[:-1], len(terms)), tuple(terms))
    made.ground = True
    return made


_atom = lru_cache(maxsize=4096)(atom)


Parse = Callable[[Source, int, int], Sequence[Item]]
"""Parses the items between two offsets of a source."""


def has_many_facts(text: str) -> bool:
    """Estimate whether the number or size of a program's facts is large enough for recognising them to save time."""
    many = 1 if len(text) >= LARGE else MANY
    return next(islice(_FACT_FOLLOWS.finditer(text), many - 1, None), None) is not None


def run_finder(source: Source, parse: Parse) -> Callable[[int], FactRun | None]:
    """Return what finds the run of facts that begins at an offset; None where no fact is recognised."""

    def find(at: int) -> FactRun | None:
        run = FactRun(source, at, parse)
        return run if run.facts else None

    return find


class FactRun:
    """Facts that follow one another in a text, from one offset to another."""

    __slots__ = ("_parse", "end", "facts", "source", "start")

    def __init__(self, source: Source, start: int, parse: Parse) -> None:
        self.source, self.start, self._parse = source, start, parse
        self.facts: list[GroundFact] = []
        match, text, at = _recogniser().fact.match, source.text, start
        while len(self.facts) < LONGEST_RUN and (found := match(text, at)) is not None:
            self.facts.append(GroundFact(self, found.start(1), found.end(1)))
            at = found.end()
        self.end = at

    def parse(self) -> None:
        """Give all facts their syntax."""
        for fact, parsed in zip(self.facts, self._parse(self.source, self.start, self.end), strict=True):
            assert isinstance(parsed, Belief)
            fact.literal, fact.position = parsed.literal, parsed.position


class _Recogniser(Struct, frozen=True):
    """``fact`` matches a fact with the blanks and comments before it, the fact itself in group 1.

    ``token`` finds what its term is made of: numbers, strings, atoms, ``name(``, ``[``, ``]`` and ``)``.
    """

    fact: re.Pattern[str]
    token: re.Pattern[str]


@lru_cache(maxsize=1)
def _recogniser() -> _Recogniser:
    """Return the expressions for the terminals of the grammar, compiled on the first call: it takes 20 ms.

    Nothing in them is tried twice (atomic groups, possessive repeats): the time is in proportion to the text's length.
    """
    tables = load()
    captures = re.compile(r"(?<!\\)\((?!\?)")
    terminal = {name: f"(?>{captures.sub('(?:', pattern)})" for name, pattern in tables.patterns.items()}
    ends = "(?![a-zA-Z0-9_])"
    name, quoted, blank = terminal["NAME"], terminal["QUOTED"], f"{terminal['BLANK']}?+"
    number, string = f"-?+{terminal['NUMBER']}", terminal["STRING"]
    operators = "|".join(word for word in tables.keywords if word not in ("true", "false"))
    word = f"(?:{quoted}|(?!(?:{operators}){ends}){name})"
    head = f"(?:{quoted}|(?!(?:{'|'.join(tables.keywords)}){ends}){name})"

    def several(depth: int) -> str:
        """Return the pattern of terms between brackets: after each a comma and another one, or the closing bracket."""
        one = f"{number}|{string}|{word}"
        if depth:
            inner = several(depth - 1)
            one = rf"{number}|{string}|{head}\({inner}\)|{word}|\[{blank}(?:{inner})?+\]"
        return rf"{blank}(?:(?>{one}){blank}(?:,{blank}(?![\])])|(?=[\])])))++"

    skipped = f"(?>{terminal['BLANK']}|{terminal['COMMENT']})*+"
    annotations = rf"\[{blank}(?:{several(1)})?+\]"
    fact = rf"{skipped}(~?+{head}(?:\({several(DEEPEST)}\))?+(?:{annotations})?+){blank}\.{ends}"
    token = rf"(?:{name}|{quoted})\(?+|{number}|{string}|[\])[]"
    return _Recogniser(re.compile(fact), re.compile(token))
