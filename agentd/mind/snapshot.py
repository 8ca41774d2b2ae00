"""What a mind shows of itself: plain facts for the live view, made when asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from agentd.language.term_text import text
from agentd.language.terms import Literal
from agentd.mind.frames import ARGS, RELEVANT, STEP
from agentd.mind.intentions import Intention
from agentd.mind.resolving import resolve_all


@dataclass(frozen=True, slots=True)
class GoalView:
    """A goal or event of a stack: its trigger as text, and ``file:line`` of the formula it is at."""

    trigger: str
    position: str


@dataclass(frozen=True, slots=True)
class IntentionView:
    """An intention: ``state`` is running, waiting or suspended, ``reason`` what it waits for, innermost goal first."""

    id: int
    state: str
    reason: str
    stack: tuple[GoalView, ...]


@dataclass(frozen=True, slots=True)
class BeliefView:
    """A belief as text, without and with its annotations."""

    literal: str
    annotated: str


def views_of_intentions(mind: Any) -> list[IntentionView]:
    pending = {e[3].id: e for e in mind.events if e[3] is not None}
    return [_view(i, pending.get(i.id)) for i in mind.all_intentions() if i.stack]


def _view(intention: Intention, event: Any) -> IntentionView:
    state, reason = "running", ""
    if intention.suspended is not None:
        state, reason = "suspended", intention.suspended
    elif intention.waiting is not None:
        state, reason = "waiting", intention.waiting
    elif event is not None:
        state, reason = "waiting", f"{event[0].text}{text(Literal(event[0].sig, resolve_all(event[1])))}"
    return IntentionView(intention.id, state, reason, tuple(_goals(intention)))


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


def views_of_beliefs(mind: Any) -> list[BeliefView]:
    return [BeliefView(text(fact.bare()), text(fact)) for fact in mind.beliefs.facts()]
