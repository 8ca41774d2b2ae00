"""Explain decisions: which plan was chosen for an event, why not another, its outcome and its causes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

from argosy.why.answer import Kind, Line, Paragraph
from argosy.why.decision_history import Cause, Memory
from argosy.why.wording import (
    ANSWERING,
    ago,
    awaited,
    event_text,
    failure_text,
    first_up,
    goals_text,
    plan_text,
    raiser_text,
    rejected_text,
    shown,
    with_values,
    without_annotations,
)
from schemas.humanize import count
from schemas.wire.mind_records import DecisionView, FailureView

MOST_PLANS = 6
"""Rejected plans that are explained; further ones are counted."""
WITHOUT_PLAN = ("no_relevant", "no_applicable")
"""Errors of goals that found no plan."""
MOST_LINKS = 8
"""Steps back that are explained; further ones are counted."""
MOST_FOLLOWED = 400
"""Steps back that are followed."""
OF_A_RESTART = ("restarted/1", "interrupted/3")
"""Events that agentd raises in a restarted agent."""


def groups(decisions: Iterable[DecisionView]) -> list[list[DecisionView]]:
    """Group decisions with the same reasons and outcome; the group with the newest decision is last."""
    found: dict[tuple[object, ...], list[DecisionView]] = {}
    for decision in decisions:
        shape = _shape(decision)
        found[shape] = [*found.pop(shape, []), decision]
    return list(found.values())


def _shape(made: DecisionView) -> tuple[object, ...]:
    rejected = tuple((one.plan.position, one.plan.trigger, one.why, one.literal) for one in made.rejected)
    chosen = made.chosen.position if made.chosen is not None else ""
    failed = (made.failure.position, made.failure.error) if made.failure is not None else ()
    return (made.kind, made.name, chosen, rejected, failed, made.outcome == "dropped")


def decision_paragraph(memory: Memory, group: list[DecisionView]) -> Paragraph:
    """Explain the newest decision of a group; the others are counted."""
    made = group[-1]
    lines = [Line(f"{ago(memory.now, made.time)}: {_head(made)}", 0, made.chosen.position if made.chosen else "")]
    lines += [
        Line(f"Not {plan_text(one.plan)}: {rejected_text(one)}.", 1, one.plan.position)
        for one in made.rejected[:MOST_PLANS]
    ]
    if len(made.rejected) > MOST_PLANS:
        lines.append(Line(f"And {count(len(made.rejected) - MOST_PLANS, 'other plan')}.", 1))
    if made.untried:
        names = [plan_text(plan) for plan in made.untried[:2]]
        if len(made.untried) > 2:
            names.append(count(len(made.untried) - 2, "other plan"))
        lines.append(Line(f"Not tried: {', '.join(names)}.", 1, made.untried[0].position))
    lines += cause_lines(memory, made)
    lines += _became(memory, made)
    if len(group) > 1:
        lines.append(
            Line(f"The same {count(len(group) - 1, 'time')} before, first {ago(memory.now, group[0].time)}.", 1)
        )
    failed = made.outcome == "failed" or (made.chosen is None and "!" in made.kind)
    kind: Kind = "dropped" if made.outcome == "dropped" else "failure" if failed else "decision"
    return Paragraph(kind, tuple(lines), made.time, len(group))


def _head(made: DecisionView) -> str:
    event = event_text(made.event)
    if made.chosen is not None:
        return f"for {event} the plan {plan_text(made.chosen)} was chosen{with_values(made.chosen.bindings)}."
    if made.rejected:
        return f"no plan was applicable for {event}."
    return f"there is no plan for {event}."


def _became(memory: Memory, made: DecisionView) -> Iterator[Line]:
    match made.outcome:
        case "running":
            yield _running(memory, made)
        case "ended":
            yield Line("The plan has ended.", 1)
        case "dropped":
            where = f" ({made.dropped_at})" if made.dropped_at else ""
            by = f" by {shown(made.dropped_by)}{where}" if made.dropped_by else ": the plan did not come to its end"
            yield Line(f"It was dropped{by}.", 1, made.dropped_at)
        case "failed" if made.failure is not None:
            yield from failure_lines(memory, made.failure)
        case "none" if "!" in made.kind or "?" in made.kind:
            same = (one for one in memory.failures if one.cycle == made.cycle and one.error in WITHOUT_PLAN)
            failure = next(same, None)
            yield from [Line("So it failed.", 1)] if failure is None else aftermath(memory, failure)
        case "none":
            yield Line("So nothing was done about it.", 1)


def _running(memory: Memory, made: DecisionView) -> Line:
    for intention in memory.view.intentions:
        if intention.id == made.intention:
            where = f" at {intention.at}" if intention.at else ""
            if intention.stack and intention.stack[0] != without_annotations(made.event):
                inner = raiser_text(intention.stack[0])
                return Line(f"The plan still runs: it waits for {inner}, which is{where}.", 1, intention.at)
            waits = awaited(intention.waits_for, " and waits for ")
            if intention.state == "suspended":
                waits = ", suspended"
            return Line(f"The plan still runs{where}{waits}.", 1, intention.at)
    return Line("The plan still runs.", 1)


def failure_lines(memory: Memory, failure: FailureView) -> Iterator[Line]:
    """Explain what failed in a plan, and the consequences."""
    at = f" at {failure.position}" if failure.position else ""
    yield Line(f"The plan failed{at}: {failure_text(failure)}.", 1, failure.position)
    yield from aftermath(memory, failure)


def aftermath(memory: Memory, failure: FailureView) -> Iterator[Line]:
    """Explain the outcome of the goals of a failure."""
    own = (failure.formula,) if failure.error in WITHOUT_PLAN else ()
    goals = tuple(dict.fromkeys((*map(without_annotations, own), *failure.given_up)))
    asked = ANSWERING in goals
    goals = tuple(goal for goal in goals if goal != ANSWERING)
    given_up = f"{goals_text(goals)} failed" if goals else "the goal failed"
    if asked and not failure.handled_by:
        answer = "the answer was `false`" if failure.error == "test_goal_failed" else "no answer was given"
        yield Line(f"So {given_up}, and {answer}.", 1)
        return
    if not failure.handled_by:
        yield Line(f"So {given_up}, and the intention ended: no plan handles this failure.", 1)
        return
    handler = memory.led_to(failure)
    if handler is None or handler.chosen is None:
        yield Line(f"So {given_up}; the failure plan {failure.handled_by} was to handle it.", 1)
        return
    plan = plan_text(handler.chosen)
    yield Line(f"So {given_up}, and the failure plan {plan} handled it.", 1, handler.chosen.position)


def cause_lines(memory: Memory, decision: DecisionView, called: str = "it") -> list[Line]:
    """Explain the cause of an event, a line for each step back; the first one names it `called`."""
    lines: list[Line] = []
    known: dict[tuple[str, ...], int] = {}
    rounds = further = 0
    last: tuple[DecisionView, Cause] | None = None
    for made, cause in islice(memory.chain(decision), MOST_FOLLOWED):
        last = made, cause
        shape = (made.kind, made.name, made.asked_at, "" if cause.failure is None else cause.failure.position)
        known[shape] = known.get(shape, 0) + 1
        if cause.by is None and cause.failure is None:
            break  # the origin, explained below
        if known[shape] > 1:
            rounds = max(rounds, known[shape] - 1)
        elif len(lines) >= MOST_LINKS:
            further += 1
        else:
            lines += _link(made, cause, event_text(made.event) if lines else called)
    if further:
        lines.append(Line(f"... and {count(further, 'step')} more back.", 1))
    if rounds:
        lines.append(Line(f"This loop ran {count(rounds, 'time')} before, as far as is remembered.", 1))
    if last is not None and last[1].by is None and last[1].failure is None:
        first = last[0]
        subject = first_up(event_text(first.event) if lines else called)
        place = "" if first.goal == ANSWERING else first.asked_at
        lines.append(Line(f"{subject} {origin_text(memory, first)}.", 1, place))
    return lines


def _link(made: DecisionView, cause: Cause, subject: str) -> Iterator[Line]:
    if cause.failure is not None:
        failure, place = cause.failure, cause.failure.position
        at = f" at {place}" if place else ""
        yield Line(f"{first_up(subject)} follows this failure{at}: {failure_text(failure)}.", 1, place)
    elif cause.by is not None:
        at = f" at {made.asked_at}" if made.asked_at else ""
        focus = ", as an intention of its own" if cause.own_focus and made.kind == "+!" else ""
        text = f"The plan for {raiser_text(cause.by.event)} {_verb(made)} {subject}{at}{focus}."
        yield Line(text, 1, made.asked_at)


def _verb(made: DecisionView) -> str:
    match made.kind:
        case "+!":
            return "set"
        case "+?":
            return "asked"
        case "-":
            return "removed"
        case "+":
            return "added"
    return "raised"


def origin_text(memory: Memory, made: DecisionView) -> str:
    """Return the origin of an event without a remembered cause, as a predicate: `comes from a percept`."""
    if made.goal == ANSWERING:
        return f"was asked by {made.source} in a message" if made.source else "was asked by another agent"
    cause, at = made.cause, f" at {made.asked_at}" if made.asked_at else ""
    match None if cause is None else cause.kind:
        case "program" if made.kind == "+" and made.name in OF_A_RESTART:
            return "is raised by agentd in a restarted agent"
        case "program":
            return "is an initial belief or goal of the program"
        case "outside":
            return "was given from outside: by an operator, the mission or a restart"
        case "percept":
            return "comes from a percept"
    if cause is not None and cause.kind == "message":
        identity = f" {cause.message}" if cause.message else ""
        return f"comes from a message of {cause.sender} ({cause.performative}{identity})"
    if cause is not None and cause.kind == "told":
        return f"was told by {cause.sender}"
    if made.goal:
        raiser = raiser_text(made.goal)
        return f"comes from {raiser}, whose plan {_verb(made)} it{at}; earlier causes are not remembered"
    if cause is not None:
        plan = memory.plan_at(made.asked_at)
        which = "a plan" if plan is None else f"the plan {plan_text(plan)}"
        return f"was raised{at} by {which}; why that plan ran is not remembered"
    return "comes from the agent itself"
