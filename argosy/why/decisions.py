"""Decisions in words: which plan was chosen for an event, why not another, and what became of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from argosy.why.answer import Kind, Line, Paragraph
from argosy.why.causes import cause_lines
from argosy.why.decision_history import Memory
from argosy.why.wording import (
    ANSWERING,
    ago,
    awaited,
    event_words,
    failure_words,
    goals_words,
    plan_words,
    raiser_words,
    rejected_words,
    shown,
    with_values,
    without_annotations,
)
from schemas.humanize import count
from schemas.wire.mind_records import DecisionView, FailureView, IntentionView, RejectedView

MOST_PLANS = 6
"""So many rejected plans are told; of further ones the number."""
WITHOUT_PLAN = ("no_relevant", "no_applicable")
"""Errors of goals that found no plan."""


def groups(decisions: Iterable[DecisionView]) -> list[list[DecisionView]]:
    """Decisions that were made for the same reasons and ended alike together; the group with the newest last."""
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
    """The newest decision of a group in full; the others are counted."""
    made = group[-1]
    lines = [Line(f"{ago(memory.now, made.time)}: {_head(made)}", 0, made.chosen.position if made.chosen else "")]
    if made.rejected:
        lines += _rejected_lines(made.rejected, chosen=made.chosen is not None)
    lines += _untried(made)
    lines += cause_lines(memory, made)
    lines += _became(memory, made)
    if len(group) > 1:
        lines.append(
            Line(f"The same {count(len(group) - 1, 'time')} before, first {ago(memory.now, group[0].time)}.", 1)
        )
    kind: Kind = "dropped" if made.outcome == "dropped" else "failure" if _is_failure(made) else "decision"
    return Paragraph(kind, tuple(lines), made.time, len(group))


def _is_failure(made: DecisionView) -> bool:
    return made.outcome == "failed" or (made.chosen is None and "!" in made.kind)


def _head(made: DecisionView) -> str:
    event = event_words(made.event)
    if made.chosen is not None:
        return f"for {event} the plan {plan_words(made.chosen)} was chosen{with_values(made.chosen.bindings)}."
    if made.rejected:
        return f"no plan could be chosen for {event}."
    return f"there is no plan for {event}."


def _rejected_lines(rejected: tuple[RejectedView, ...], chosen: bool) -> Iterator[Line]:
    for one in rejected[:MOST_PLANS]:
        yield Line(f"Not {plan_words(one.plan)}: {rejected_words(one)}.", 1, one.plan.position)
    if len(rejected) > MOST_PLANS:
        yield Line(f"Nor {count(len(rejected) - MOST_PLANS, 'other plan')}.", 1)


def _untried(made: DecisionView) -> Iterator[Line]:
    if made.untried:
        names = [plan_words(plan) for plan in made.untried[:2]]
        if len(made.untried) > 2:
            names.append(count(len(made.untried) - 2, "other plan"))
        yield Line(f"Not needed after it: {', '.join(names)}.", 1, made.untried[0].position)


def _became(memory: Memory, made: DecisionView) -> Iterator[Line]:
    match made.outcome:
        case "running":
            yield _running(memory, made)
        case "ended":
            yield Line("The plan has come to its end.", 1)
        case "dropped":
            where = f" ({made.dropped_at})" if made.dropped_at else ""
            by = f" by {shown(made.dropped_by)}{where}" if made.dropped_by else ": the plan did not come to its end"
            yield Line(f"It was dropped{by}.", 1, made.dropped_at)
        case "failed" if made.failure is not None:
            yield from failure_lines(memory, made.failure)
        case "none" if "!" in made.kind or "?" in made.kind:
            yield from _unchosen(memory, made)
        case "none":
            yield Line("So nothing was done about it.", 1)


def _running(memory: Memory, made: DecisionView) -> Line:
    for intention in memory.view.intentions:
        if intention.id == made.intention:
            where = f" at {intention.at}" if intention.at else ""
            if intention.stack and intention.stack[0] != without_annotations(made.event):
                inner = raiser_words(intention.stack[0])
                return Line(f"The plan still runs: it waits for {inner}, which is{where}.", 1, intention.at)
            return Line(f"The plan still runs{where}{_waits(intention)}.", 1, intention.at)
    return Line("The plan still runs.", 1)


def _waits(intention: IntentionView) -> str:
    if intention.state == "suspended":
        return ", suspended"
    return "" if intention.waits_for is None else f" and waits for {awaited(intention.waits_for)}"


def failure_lines(memory: Memory, failure: FailureView) -> Iterator[Line]:
    """What failed in a plan, and what that led to."""
    at = f" at {failure.position}" if failure.position else ""
    yield Line(f"The plan failed{at}: {failure_words(failure)}.", 1, failure.position)
    yield from aftermath(memory, failure)


def aftermath(memory: Memory, failure: FailureView) -> Iterator[Line]:
    """What became of the goals of a failure."""
    own = (failure.formula,) if failure.error in WITHOUT_PLAN else ()
    goals = tuple(dict.fromkeys((*map(without_annotations, own), *failure.given_up)))
    asked = ANSWERING in goals
    goals = tuple(goal for goal in goals if goal != ANSWERING)
    given_up = f"{goals_words(goals)} failed" if goals else "the goal failed"
    if asked and not failure.handled_by:
        answer = "the answer was `false`" if failure.error == "test_goal_failed" else "no answer was given"
        yield Line(f"So {given_up}, and {answer}.", 1)
        return
    if not failure.handled_by:
        yield Line(f"So {given_up}, and the intention ended: no plan handles such a failure.", 1)
        return
    handler = memory.led_to(failure)
    if handler is None or handler.chosen is None:
        yield Line(f"So {given_up}; {failure.handled_by} was to go on from there.", 1)
        return
    plan = plan_words(handler.chosen)
    yield Line(f"So {given_up}, and the failure plan {plan} went on from there.", 1, handler.chosen.position)


def _unchosen(memory: Memory, made: DecisionView) -> Iterator[Line]:
    for failure in memory.failures:
        if failure.cycle == made.cycle and failure.error in WITHOUT_PLAN:
            yield from aftermath(memory, failure)
            return
    yield Line("So it failed.", 1)
