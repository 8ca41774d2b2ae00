"""The present state of a mind as records for people: intentions, events, questions and beliefs."""

from __future__ import annotations

from itertools import islice
from typing import Final

from agentd.language.terms.format import text
from agentd.language.terms.source_annotations import is_source
from agentd.language.terms.terms import Literal, Term
from agentd.mind.beliefs.term_copy import resolve_all, resolve_annots
from agentd.mind.data.intention import ARGS, PLAN, RELEVANT, STEP, Event, Intention
from agentd.mind.introspection.snapshots import place, short_text
from agentd.mind.state import MindState
from schemas.wire.mind_records import BeliefView, EventView, IntentionView, QuestionView, WaitView

MOST_GOALS: Final = 100
"""Goals shown of an intention, the top of its stack first."""


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
