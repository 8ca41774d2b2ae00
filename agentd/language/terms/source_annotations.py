"""Sources: the annotations ``source(S)``, the origin of a belief or an event."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom

_SOURCE: Final = signature("source", 1)


def source(who: Any) -> Literal:
    """``source(who)``."""
    return Literal(_SOURCE, (who,))


SOURCE_SELF: Final = source(atom("self"))
SOURCE_SELF.ground = True
SELF: Final = (SOURCE_SELF,)
"""The annotations of a mind's own beliefs and events: ``[source(self)]``. Compare with ``is`` first."""
SOURCE_PERCEPT: Final = source(atom("percept"))
SOURCE_PERCEPT.ground = True
PERCEPT: Final = (SOURCE_PERCEPT,)


@lru_cache(maxsize=1024)
def told_by(name: str) -> tuple[Literal, ...]:
    """``[source(name)]``: one object per name, so that annotations compare by identity first."""
    who = source(atom(name))
    who.ground = True
    return (who,)


def is_source(term: Any) -> bool:
    """Return whether an annotation is ``source(_)``."""
    return type(term) is Literal and term.sig is _SOURCE


def told_by_others(annots: tuple[Any, ...]) -> bool:
    """Return whether annotations name a source other than the mind itself: a percept or another agent."""
    return any(is_source(a) and a != SOURCE_SELF for a in annots)
