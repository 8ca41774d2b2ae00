"""The machine that runs the parse tables: iterative, so that any depth of nesting parses.

Values are built while parsing, by the methods of a builder that are named as the rules of the grammar; no parse tree
comes into being. A builder's method gets the offset where its rule begins and the children that the rule keeps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from operator import itemgetter
from typing import Any, TypeAlias

from msgspec import Struct

from agentd.language.parser.build_terms import TermBuilder
from agentd.language.parser.lexer import END_OF_TEXT, Tokens
from agentd.language.parser.parse_tables import RuleTable, Tables, load

_BUILD, _UNIT, _SELECT, _LIST, _EXTEND = range(5)


class Reduction(Struct, frozen=True):
    """A rule as the machine uses it; ``pick`` makes the builder's arguments of the symbols, None: as they are."""

    kind: int
    origin: str
    name: str
    size: int
    pick: Callable[[list[Any]], Sequence[Any]] | None
    index: int


Recovery: TypeAlias = Callable[[int, list[int], list[int], bool], int | None]
"""What to do where no rule goes on: reports the problem and gives the index to go on at, or None to stop.

It gets the index of the token, the stack of the machine, the state that does not go on last, the offsets where what led
to each begins, and whether no token of an item has been read yet.
"""


class Stopped(Exception):
    """The text has problems, all reported; there is no value."""


class Machine:
    """An LALR(1) parser for the tables of one grammar. Holds nothing of a particular text.

    ``entered_by`` gives the symbol that has been read when a state is entered.
    """

    def __init__(self, tables: Tables) -> None:
        self.tables = tables
        self.reductions = [_reduction(rule) for rule in tables.rules]
        self.entered_by = {a: symbol for row in tables.states for symbol, a in row.items() if a >= 0}
        self._chains: dict[tuple[int, int, str], int] = {}

    def run(self, tokens: Tokens, start: str, builder: TermBuilder, recover: Recovery) -> Any:
        """Return the value of a text that is a ``start``. Raises `Stopped` if ``recover`` returns None.

        ``builder`` has a method for each rule of the grammar.
        """
        rows, reductions, chains = self.tables.states, self.reductions, self._chains
        builds = [getattr(builder, r.name) if r.kind == _BUILD else None for r in reductions]
        types, texts, starts = tokens.types, tokens.texts, tokens.starts
        end = self.tables.ends[start]
        state = self.tables.starts[start]
        states, offsets = [state], [0]
        values: list[Any] = [None]
        index = 0
        kind = types[0]
        while True:
            action = rows[state].get(kind)
            if action is None:
                builder.unfinished(values)
                kept = self._complete(states)
                resume = recover(index, states, offsets, len(states) == kept)
                if resume is None:
                    raise Stopped
                index = resume
                kind = types[index]
                del states[kept:], values[kept:], offsets[kept:]
                state = states[-1]
            elif action >= 0:
                states.append(action)
                values.append(texts[index])
                offsets.append(starts[index])
                state = action
                index += 1
                kind = types[index]
            elif (rule := reductions[~action]).kind == _UNIT:
                # Most reductions only climb the ladder of precedences: climb it in one go, and remember the way.
                way = (states[-2], state, kind)
                climbed = chains.get(way)
                if climbed is None:
                    climbed = chains[way] = self._climb(*way)
                states[-1] = state = climbed
            else:
                size = rule.size
                if size:
                    children = values[-size:]
                    at = offsets[-size]
                    del values[-size:], states[-size:], offsets[-size:]
                else:
                    children, at = [], starts[index]
                build = builds[~action]
                if build is not None:
                    value = build(at, *(children if rule.pick is None else rule.pick(children)))
                elif rule.kind == _SELECT:
                    value = children[rule.index]
                else:  # a list that the rule above takes its children from
                    value = children if rule.pick is None else rule.pick(children)
                state = rows[states[-1]][rule.origin]
                if state == end and kind == END_OF_TEXT:
                    return value
                states.append(state)
                values.append(value)
                offsets.append(at)

    def accepted(self, states: Sequence[int]) -> frozenset[str]:
        """Return the types of the tokens that can follow; the last state alone has actions for some more."""
        return frozenset(kind for kind in self.tables.states[states[-1]] if self._goes_on(states, kind))

    def _goes_on(self, states: Sequence[int], kind: str) -> bool:
        """Return whether a token can be shifted, or ends the text, after the reductions that it leads to."""
        rows = self.tables.states
        kept, above = len(states), [states[-1]]
        kept -= 1
        while (action := rows[above[-1]].get(kind)) is not None:
            if action >= 0:
                return kind.isupper()  # the name of a rule is no token
            rule = self.reductions[~action]
            for _ in range(rule.size):
                if above:
                    above.pop()
                else:
                    kept -= 1
            below = above[-1] if above else states[kept - 1]
            above.append(rows[below][rule.origin])
            if kind == END_OF_TEXT and above[-1] in self.tables.ends.values():
                return True
        return False

    def _climb(self, below: int, state: int, kind: str) -> int:
        """Return the state after all reductions that only rename the top of the stack."""
        rows = self.tables.states
        while (action := rows[state].get(kind)) is not None and action < 0:
            rule = self.reductions[~action]
            if rule.kind != _UNIT:
                break
            state = rows[below][rule.origin]
        return state

    def _complete(self, states: list[int]) -> int:
        """Return how many states hold the items of the program that are complete: 1 without any, else 2."""
        start = self.tables.states[states[0]]
        items = [state for symbol, state in start.items() if symbol.startswith("__program_star")]
        return 2 if len(states) > 1 and states[1] in items else 1


@lru_cache(maxsize=1)
def machine() -> Machine:
    """Return the machine for the dialect's grammar."""
    return Machine(load())


def _reduction(rule: RuleTable) -> Reduction:
    children = rule.children
    index = children[0] if children else 0
    if rule.transparent or (rule.listing and children == rule.spliced and len(children) == 1):
        kind = _UNIT if rule.size == 1 else _SELECT
        return Reduction(kind, rule.origin, rule.name, rule.size, None, index)
    if rule.listing:
        extends = bool(rule.spliced) and children[0] == rule.spliced[0]
        pick = _extender(children, rule.spliced) if extends else _splicer(children, rule.spliced)
        return Reduction(_EXTEND if extends else _LIST, rule.origin, rule.name, rule.size, pick, index)
    return Reduction(_BUILD, rule.origin, rule.name, rule.size, _picker(children, rule.spliced, rule.size), index)


def _picker(children: list[int], spliced: list[int], size: int) -> Callable[[list[Any]], Sequence[Any]] | None:
    if spliced:
        return _splicer(children, spliced)
    if children == list(range(size)):
        return None
    if len(children) == 1:
        only = children[0]
        return lambda values: (values[only] if only >= 0 else None,)
    if not children:
        return lambda _: ()
    choose = itemgetter(*children)

    def pick(values: list[Any]) -> Sequence[Any]:
        values.append(None)  # index -1: an optional part that is absent
        chosen: Sequence[Any] = choose(values)
        return chosen

    return pick


def _splicer(children: list[int], spliced: list[int]) -> Callable[[list[Any]], Sequence[Any]]:
    def splice(values: list[Any]) -> Sequence[Any]:
        picked: list[Any] = []
        for child in children:
            if child in spliced:
                picked.extend(values[child])
            else:
                picked.append(values[child] if child >= 0 else None)
        return picked

    return splice


def _extender(children: list[int], spliced: list[int]) -> Callable[[list[Any]], Sequence[Any]]:
    """Left-recursive lists grow in place: nothing else holds them, and a program of n items costs n steps."""
    first, rest = children[0], children[1:]

    def extend(values: list[Any]) -> Sequence[Any]:
        gathered: list[Any] = values[first]
        for child in rest:
            gathered.extend(values[child] if child in spliced else (values[child],))
        return gathered

    return extend
