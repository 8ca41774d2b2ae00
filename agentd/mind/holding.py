"""Terms as they are now, for records that are read later: by reference where they cannot change, else a short copy."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any, Final

from agentd.language.term_text import text
from agentd.language.terms import EMPTY, Code, Collection, Expression, List, Literal, Var, atom, deref, make_list

_MOST_COPIED: Final = 60
"""So many parts of a term with variables in it are copied; what lies beyond shows as ``...``."""
_MOST_LOOKED_AT: Final = 2_000
"""So many parts of a term are looked at for variables; numbers and strings in a list do not count."""
_FLAT: Final = frozenset((float, str))
_LONGEST: Final = 200
"""Characters of a term that are shown."""

MORE: Final = atom("...")
"""Stands for the part of a term that was not held."""


def held(term: Any) -> Any:
    """The term as it is now: whatever is bound or freed later shows no change in it."""
    kind = type(term)
    if kind is float or kind is str or ((kind is Literal or kind is List) and term.ground):
        return term
    term = deref(term)
    if _is_ground(term):
        return term
    return _Copy(lambda part: part.ground).of(term)


def held_all(terms: tuple[Any, ...]) -> tuple[Any, ...]:
    """The terms as they are now."""
    for term in terms:
        kind = type(term)
        if kind is not float and kind is not str and not (kind is Literal and term.ground):
            return tuple([held(t) for t in terms])
    return terms


def _is_ground(term: Any) -> bool:
    """Whether no variable is inside, bound or free; noted in the literals and lists looked through, so seldom asked."""
    pending, seen = [term], []
    budget = _MOST_LOOKED_AT
    while pending:
        budget -= 1
        if not budget:
            return False
        part = pending.pop()
        kind = type(part)
        if kind is Literal:
            if not part.ground:
                seen.append(part)
                pending += part.args
                pending += part.annots
        elif kind is List:
            if not part.ground:
                seen.append(part)
                items = part.items[part.at :]
                if not _FLAT.issuperset(map(type, items)):
                    pending += items
                pending.append(part.tail)
        elif kind is not float and kind is not str:
            return False
    for part in seen:
        part.ground = True
    return True


class _Copy:
    """A copy of a term, cut off where it gets long; a variable that occurs twice in it stays one variable."""

    def __init__(self, keeps: Callable[[Any], bool]) -> None:
        self._left = _MOST_COPIED
        self._keeps = keeps
        """Which literals and lists need not be copied."""
        self._variables: dict[int, Var] = {}

    def of(self, term: Any) -> Any:
        self._left -= 1
        if self._left < 0:
            return MORE
        term = deref(term)
        match term:
            case Literal():
                return term if self._keeps(term) else Literal(term.sig, self._each(term.args), self._each(term.annots))
            case List():
                return term if self._keeps(term) else self._list(term)
            case Var():
                return self._variables.setdefault(id(term), Var(term.name))
            case Expression():
                return Expression(term.operator, self._each(term.operands))
            case Code():
                return Code(term.syntax, {name: self.of(value) for name, value in term.values.items()}, term.bare)
            case Collection():
                return Collection(term.kind, copy(term.content)) if len(term.content) <= _MOST_COPIED else MORE
        return term

    def _each(self, terms: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple([self.of(t) for t in terms])

    def _list(self, term: List) -> Any:
        items: list[Any] = []
        rest: Any = term
        while type(rest) is List and rest is not EMPTY and not self._keeps(rest) and self._left > 0:
            items.append(self.of(rest.head))
            rest = deref(rest.rest())
        return make_list(items, self.of(rest))


def short_text(term: Any) -> str:
    """The text of a term for people: of a long one only the beginning."""
    whole = text(_Copy(lambda part: part is EMPTY).of(term))
    return whole if len(whole) <= _LONGEST else f"{whole[: _LONGEST - 3]}..."
