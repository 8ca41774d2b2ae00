"""The way back from an event to the percept, message or line of the program that caused it, in words."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from argosy.why.answer import Line
from argosy.why.decision_history import Cause, Memory
from argosy.why.wording import ANSWERING, event_words, failure_words, first_up, plan_words, raiser_words
from schemas.humanize import count
from schemas.wire.mind_records import DecisionView

MOST_LINKS = 8
"""So many steps back are told; of further ones the number."""
MOST_FOLLOWED = 400
"""So many are followed at most."""
OF_A_RESTART = ("restarted/1", "interrupted/3")
"""Events that the daemon raises in an agent that it has started again; nobody tells them, and no program begins so."""


def cause_lines(memory: Memory, decision: DecisionView, called: str = "it", indent: int = 1) -> list[Line]:
    """Where an event comes from, a line for each step back; it is `called` so in the first of them."""
    lines: list[Line] = []
    known: dict[tuple[str, ...], int] = {}
    rounds = further = 0
    last: tuple[DecisionView, Cause] | None = None
    for made, cause in islice(memory.chain(decision), MOST_FOLLOWED):
        last = made, cause
        shape = (made.kind, made.name, made.asked_at, "" if cause.failure is None else cause.failure.position)
        known[shape] = known.get(shape, 0) + 1
        if cause.by is None and cause.failure is None:
            break  # told as the end of it
        if known[shape] > 1:
            rounds = max(rounds, known[shape] - 1)
        elif len(lines) >= MOST_LINKS:
            further += 1
        else:
            lines += _link(made, cause, event_words(made.event) if lines else called, indent)
    if further:
        lines.append(Line(f"... and {count(further, 'step')} more back.", indent))
    if rounds:
        lines.append(Line(f"So it went round {count(rounds, 'time')} before, as far as is remembered.", indent))
    if last is not None and last[1].by is None and last[1].failure is None:
        lines += _origin(memory, last[0], event_words(last[0].event) if lines else called, indent)
    return lines


def _link(made: DecisionView, cause: Cause, subject: str, indent: int) -> Iterator[Line]:
    if cause.failure is not None:
        failure, place = cause.failure, cause.failure.position
        at = f" at {place}" if place else ""
        yield Line(f"{first_up(subject)} comes from this{at}: {failure_words(failure)}.", indent, place)
    elif cause.by is not None:
        at = f" at {made.asked_at}" if made.asked_at else ""
        focus = ", as an intention of its own" if cause.own_focus and made.kind == "+!" else ""
        text = f"{first_up(subject)} comes from {raiser_words(cause.by.event)}, whose plan {_verb(made)} it{at}{focus}."
        yield Line(text, indent, made.asked_at)


def _verb(made: DecisionView) -> str:
    match made.kind:
        case "+!":
            return "set"
        case "+?":
            return "asked"
        case "-":
            return "took away"
        case "+":
            return "added"
    return "raised"


def _origin(memory: Memory, made: DecisionView, subject: str, indent: int) -> Iterator[Line]:
    place = "" if made.goal == ANSWERING else made.asked_at
    yield Line(f"{first_up(subject)} {origin_words(memory, made)}.", indent, place)


def origin_words(memory: Memory, made: DecisionView) -> str:
    """Where an event comes from that nothing remembered has led to, as what it does: `comes from a percept`."""
    if made.goal == ANSWERING:
        return f"was asked by {made.source} in a message" if made.source else "was asked by another agent"
    cause, at = made.cause, f" at {made.asked_at}" if made.asked_at else ""
    match None if cause is None else cause.kind:
        case "program" if made.kind == "+" and made.name in OF_A_RESTART:
            return "comes from its restart: agentd tells it to an agent that was started again"
        case "program":
            return "stands in the program, which begins with it"
        case "outside":
            return "was given from outside: by an operator, the mission or a restart"
        case "percept":
            return "comes from what the agent perceives"
    if cause is not None and cause.kind == "message":
        identity = f" {cause.message}" if cause.message else ""
        return f"comes from a message of {cause.sender} ({cause.performative}{identity})"
    if cause is not None and cause.kind == "told":
        return f"was told by {cause.sender}"
    if made.goal:
        raiser = raiser_words(made.goal)
        return f"comes from {raiser}, whose plan {_verb(made)} it{at}; what was before is not remembered any more"
    if cause is not None:
        plan = memory.plan_at(made.asked_at)
        which = "a plan" if plan is None else f"the plan {plan_words(plan)}"
        return f"was raised{at} by {which}; why that ran is not remembered any more"
    return "comes from the agent itself"
