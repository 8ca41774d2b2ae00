"""What a mind shows of itself: plain facts for the live view, made when asked."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import Any, Final

from agentd.language.terms.format import flat_text, text
from agentd.language.terms.source_annotations import is_source
from agentd.language.terms.terms import EMPTY, List, Literal
from agentd.mind.beliefs.term_copy import resolve_all, resolve_annots
from agentd.mind.data.intention import ARGS, RELEVANT, STEP, Awaited, Event, Intention
from agentd.mind.introspection.term_snapshot import held, short_text
from agentd.mind.state import MindState

LONGEST_BELIEF: Final = 2_000
"""Characters of a belief that are shown."""
_MOST_LOOKED_AT: Final = 2_000
"""So many parts of a belief are looked at."""


@dataclass(frozen=True, slots=True)
class GoalView:
    """A goal or event of a stack: its trigger as text, and ``file:line`` of the formula it is at."""

    trigger: str
    position: str


@dataclass(frozen=True, slots=True)
class IntentionView:
    """An intention: ``state`` is running, waiting or suspended, its stack innermost goal first.

    ``since`` is the mission time since when it waits for something other than an event of its own.
    """

    id: int
    state: str
    waits_for: Awaited | None
    stack: tuple[GoalView, ...]
    since: float | None


@dataclass(frozen=True, slots=True)
class BeliefView:
    """A belief as text, without and with its annotations."""

    literal: str
    annotated: str


@dataclass(frozen=True, slots=True)
class EventView:
    """An event that waits to be given a plan, as text; 0 = it begins an intention of its own."""

    text: str
    name: str
    """Its functor."""
    intention: int


@dataclass(frozen=True, slots=True)
class QuestionView:
    """A question without an answer yet; ``asked`` and ``until`` are mission seconds, ``position`` is ``file:line``."""

    id: str
    receiver: str
    performative: str
    content: str
    asked: float
    until: float | None
    intention: int
    position: str


def views_of_intentions(mind: MindState, most: int | None) -> list[IntentionView]:
    pending = {e[3].id: e for e in mind.events if e[3] is not None}
    intentions = (intention for intention in mind.all_intentions() if intention.stack)
    return [_view(intention, pending.get(intention.id)) for intention in islice(intentions, most)]


def _view(intention: Intention, event: Event | None) -> IntentionView:
    state, awaited = "running", intention.waiting
    if intention.suspended is not None:
        state, awaited = "suspended", None
    elif awaited is not None:
        state = "waiting"
    elif event is not None:
        state = "waiting"
        awaited = Awaited("plan", f"{event[0].text}{text(Literal(event[0].sig, resolve_all(event[1])))}")
    since = intention.since if intention.waiting is not None else None
    return IntentionView(intention.id, state, awaited, tuple(_goals(intention)), since)


def _goals(intention: Intention) -> list[GoalView]:
    found = []
    for place, frame in enumerate(reversed(intention.stack)):
        step = frame[STEP]
        if (place == 0 and intention.waiting is not None and intention.last is not None) or step is None:
            step = intention.last if place == 0 else step
        node = step.syntax if step is not None else frame[1].syntax
        literal = Literal(frame[RELEVANT].sig, resolve_all(frame[ARGS]))
        found.append(GoalView(frame[RELEVANT].text + text(literal), f"{node.position.file}:{node.position.line}"))
    return found


def views_of_beliefs(mind: MindState) -> list[BeliefView]:
    return [BeliefView(text(fact.bare()), text(fact)) for fact in mind.beliefs.facts()]


def views_of_events(mind: MindState, most: int) -> list[EventView]:
    return [_event_view(event) for event in islice(mind.all_events(), most)]


def _event_view(event: Event) -> EventView:
    relevant, args, annots, intention = event
    literal = Literal(relevant.sig, resolve_all(args), resolve_annots(annots))
    return EventView(
        relevant.text + short_text(literal), relevant.sig.functor, 0 if intention is None else intention.id
    )


def views_of_questions(mind: MindState) -> list[QuestionView]:
    found = []
    for identity, question in mind.questions.items():
        last = question.intention.last
        position = None if last is None else last.syntax.position
        found.append(
            QuestionView(
                identity,
                question.receivers[question.ids.index(identity)],
                question.performative,
                short_text(question.content),
                question.asked,
                None if question.timer is None else question.timer.due,
                question.intention.id,
                "" if position is None else f"{position.file}:{position.line}",
            )
        )
    return found


def sources_of(fact: Literal) -> tuple[str, ...]:
    """Who told a belief, as names."""
    return tuple(_name(annot.args[0]) for annot in fact.annots if is_source(annot))


def _name(source: Any) -> str:
    plain = type(source) is Literal and not source.args and not source.annots
    return str(source.sig.name) if plain else short_text(source)


def believed(mind: MindState, most: int, about: str = "") -> tuple[list[Literal], int]:
    """The facts to be shown, and how many there are in all; ``about`` is the functor that they are to have.

    No predicate is left out for another that has many facts: each has room for an equal share, newest first.
    """
    predicates = [p for p in mind.beliefs.predicates() if not about or p.sig.functor == about]
    sizes = [len(predicate.entries) - predicate.rules for predicate in predicates]
    share = most
    left, room = sum(sizes), most
    if left > most:
        share = 0
        for place, size in enumerate(sorted(sizes)):
            share = max(1, room // (len(sizes) - place))
            room -= min(size, share)
    shown: list[Literal] = []
    for predicate, size in zip(predicates, sizes, strict=True):
        if size:
            facts = (entry for entry in reversed(predicate.entries.values()) if type(entry) is Literal)
            shown += islice(facts, min(share, most - len(shown)))
    return shown, left


def belief_text(fact: Literal) -> tuple[str, bool]:
    """The text of a belief with its annotations, of a long one only the beginning.

    And whether it stays so while it is believed: numbers, strings and structures of them, and few of these.
    """
    whole = flat_text(fact)
    if whole is not None:
        return whole, fact.ground
    whole = text(held(fact))
    return whole if len(whole) <= LONGEST_BELIEF else f"{whole[: LONGEST_BELIEF - 3]}...", _lasting(fact)


def _lasting(fact: Literal) -> bool:
    pending: list[Any] = [*fact.args, *fact.annots]
    for _ in range(_MOST_LOOKED_AT):
        if not pending:
            return fact.ground
        part = pending.pop()
        kind = type(part)
        if kind is Literal:
            pending += part.args
            pending += part.annots
        elif kind is List:
            if part is not EMPTY:
                pending += (part.tail, *part.items[part.at : part.at + _MOST_LOOKED_AT])
        elif kind is not float and kind is not str:
            return False
    return False
