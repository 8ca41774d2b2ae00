"""Terms as they are now, for records that are read later: by reference where they cannot change, else a short copy.

And what a mind is about now, as records: its intentions, events, questions and beliefs.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from itertools import islice
from typing import Any, Final

from agentd.language.syntax_tree.nodes import Position
from agentd.language.terms.format import flat_text, text
from agentd.language.terms.source_annotations import is_source
from agentd.language.terms.terms import (
    EMPTY,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Term,
    Var,
    atom,
    deref,
    make_list,
)
from agentd.mind.beliefs.term_copy import resolve_all, resolve_annots
from agentd.mind.data.intention import ARGS, PLAN, RELEVANT, STEP, VARIABLES, Event, Frame, Intention
from agentd.mind.state import MindState
from schemas.wire.mind_records import BeliefView, EventView, IntentionView, QuestionView, WaitView

_MOST_COPIED: Final = 60
"""Parts copied of a term with variables; the remainder shows as ``...``."""
_MOST_LOOKED_AT: Final = 2_000
"""Parts of a term that are searched for variables; numbers and strings in a list do not count."""
_MOST_HELD: Final = 500
"""A term of more parts is held as a short copy: records are few, so their memory is bounded if each is small."""
_LONGEST_HELD: Final = 2_000
"""Characters of a string that is held whole."""
_FLAT: Final = frozenset((float, str))
_FLOATS: Final = frozenset((float,))
_LONGEST: Final = 200
"""Characters of a term that are shown."""

MOST_GOALS: Final = 100
"""Goals shown of an intention, the top of its stack first."""
MORE: Final = atom("...")
"""Takes the place of the part of a term that was not copied."""


def held(term: Any) -> Any:
    """Return the term as it is now, without what is bound or freed later. A large one is cut short."""
    kind = type(term)
    if kind is float:
        return term
    if kind is str:
        return term if len(term) <= _LONGEST_HELD else f"{term[:_LONGEST]}..."
    if not ((kind is Literal or kind is List) and term.ground):
        term = deref(term)
        if not _is_ground(term):
            return _Copy(lambda part: part.ground and _is_small(part)).of(term)
    return term if _is_small(term) else _Copy(lambda part: part is EMPTY).of(term)


def held_all(terms: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the terms as they are now."""
    for term in terms:
        kind = type(term)
        if kind is not float and not (kind is Literal and not term.args and term.ground):
            return tuple([held(t) for t in terms])
    return terms


def _is_small(term: Any) -> bool:
    """Return whether a ground term has few parts."""
    left = _MOST_HELD
    pending = [term]
    while pending:
        part = pending.pop()
        kind = type(part)
        if kind is Literal:
            left -= 1
            pending += part.args
            pending += part.annots
        elif kind is List:
            if part is not EMPTY:
                left -= len(part.items) - part.at
                if left > 0:
                    items = part.items[part.at :]
                    if not _FLOATS.issuperset(map(type, items)):
                        pending += items
                    pending.append(part.tail)
        elif kind is str:
            left -= 1 + len(part) // 16
        else:
            left -= 1
        if left <= 0:
            return False
    return True


def _is_ground(term: Any) -> bool:
    """Return whether no variable is inside, bound or free; the answer is noted in literals and lists."""
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

    def of(self, term: Term) -> Any:
        """Return the snapshot of a term."""
        self._left -= 1
        if self._left < 0:
            return MORE
        term = deref(term)
        match term:
            case str() if len(term) > _LONGEST:
                return f"{term[:_LONGEST]}..."
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

    def _each(self, terms: tuple[Term, ...]) -> tuple[Term, ...]:
        return tuple([self.of(t) for t in terms])

    def _list(self, term: List) -> Any:
        items: list[Term] = []
        rest: Any = term
        while type(rest) is List and rest is not EMPTY and not self._keeps(rest) and self._left > 0:
            items.append(self.of(rest.head))
            rest = deref(rest.rest())
        return make_list(items, self.of(rest))


def lighten(frame: Frame) -> None:
    """Cut the large terms in the frame of a plan that has ended."""
    frame[ARGS] = held_all(frame[ARGS])
    for place in range(VARIABLES, len(frame)):
        value = frame[place]
        if type(value) is Var:
            if not _is_small(deref(value)):
                frame[place] = Var(value.name)  # it was free when the plan was selected
        elif type(value) is list or type(value) is tuple:
            frame[place] = None  # the rounds of a loop
        elif value is not None:
            frame[place] = held(value)


def short_text(term: Term) -> str:
    """Return the text of a term for people: of a long one only the beginning."""
    whole = flat_text(term)
    if whole is None:
        whole = text(_Copy(lambda part: part is EMPTY).of(term))
    return whole if len(whole) <= _LONGEST else f"{whole[: _LONGEST - 3]}..."


def place(position: Position) -> str:
    """``file:line``."""
    return f"{position.file}:{position.line}"


# --- a mind ---


def intention_views(mind: MindState, most: int | None = None) -> list[IntentionView]:
    """Return the intentions by their ids, at most ``most`` (None: all)."""
    pending = {e[3].id: e for e in mind.events if e[3] is not None}
    intentions = (intention for intention in mind.all_intentions() if intention.stack)
    return [_intention_view(intention, pending.get(intention.id)) for intention in islice(intentions, most)]


def _intention_view(intention: Intention, event: Event | None) -> IntentionView:
    state, awaited = "running", intention.waiting
    if intention.suspended is not None:
        state, awaited = "suspended", None
    elif awaited is not None:
        state = "waiting"
    elif event is not None:
        state = "waiting"
        awaited = WaitView(kind="plan", name=event[0].text + text(Literal(event[0].sig, resolve_all(event[1]))))
    frames = list(islice(reversed(intention.stack), MOST_GOALS))
    step = frames[0][STEP]
    if step is None or (intention.waiting is not None and intention.last is not None):
        step = intention.last
    node = frames[0][PLAN].syntax if step is None else step.syntax
    return IntentionView(
        id=intention.id,
        state=state,
        waits_for=awaited,
        stack=tuple(f[RELEVANT].text + text(Literal(f[RELEVANT].sig, resolve_all(f[ARGS]))) for f in frames),
        at=place(node.position),
        since=intention.since if intention.waiting is not None else None,
    )


def event_view(event: Event) -> EventView:
    """Return an event that waits to be given a plan."""
    relevant, args, annots, intention = event
    literal = Literal(relevant.sig, resolve_all(args), resolve_annots(annots))
    return EventView(text=relevant.text + short_text(literal), intention=0 if intention is None else intention.id)


def question_views(mind: MindState, life: str = "") -> list[QuestionView]:
    """Return the synchronous asks without an answer; ``life`` is what ids of messages end with on the bus."""
    ending = f".{life}" if life else ""
    return [
        QuestionView(
            id=identity + ending,
            receiver=question.receivers[question.ids.index(identity)],
            performative=question.performative,
            content=short_text(question.content),
            asked=question.asked,
            until=None if question.timer is None else question.timer.due,
            intention=question.intention.id,
            position="" if question.intention.last is None else place(question.intention.last.syntax.position),
        )
        for identity, question in mind.questions.items()
    ]


def belief_views(mind: MindState) -> list[BeliefView]:
    """Return every fact, predicate by predicate."""
    since = mind.beliefs.since
    return [
        BeliefView(text=text(fact), sources=sources_of(fact), since=since(fact)[0]) for fact in mind.beliefs.facts()
    ]


def sources_of(fact: Literal) -> tuple[str, ...]:
    """Return the sources of a belief, as names."""
    return tuple(_name(annot.args[0]) for annot in fact.annots if is_source(annot))


def _name(source: Term) -> str:
    if type(source) is Literal and not source.args and not source.annots:
        return source.sig.name
    return short_text(source)
