"""Explain the present state of an agent, and what was dropped or failed lately."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice

from argosy.why.answer import Line, Paragraph
from argosy.why.decision_history import Memory
from argosy.why.decisions import aftermath, cause_lines
from argosy.why.question import parts_of
from argosy.why.wording import (
    ANSWERING,
    ago,
    awaited,
    failure_text,
    first_up,
    plan_text,
    raiser_text,
    shown,
    sign_of,
    without_annotations,
)
from schemas.humanize import count, span
from schemas.wire.mind_records import DropView, FailureView, IntentionView, MindView

MOST_INTENTIONS = 10
"""Intentions that are explained; further ones are counted."""
MOST_GOALS = 6
"""Goals of a stack that are named."""


def standing(memory: Memory) -> Paragraph:
    """Return the state of the agent."""
    view = memory.view
    program = f" It runs {view.program}." if view.program else ""
    match view.state:
        case "paused":
            until = f" and resumes by itself in {span(view.paused_for)}" if view.paused_for is not None else ""
            state = f"is paused by an operator{until}"
        case "reasoning":
            state = "is reasoning"
        case _:
            state = "waits for something to happen"
    lines = [Line(f"{view.agent} {state} (mission second {memory.now:.1f}, cycle {view.cycle}).{program}")]
    if view.state == "paused":
        lines.append(Line("Percepts, messages and goals that arrive meanwhile wait until it resumes."))
    if not view.intentions:
        nothing = "It has no intentions."
        lines.append(Line("It had no intentions then." if view.state == "paused" else nothing))
    if view.events:
        events = [raiser_text(event.text) for event in view.events[:4]]
        left = len(view.events) + view.events_left_out - len(events)
        more = f" and {count(left, 'other event')}" if left else ""
        lines.append(Line(f"Events that wait for a plan: {', '.join(events)}{more}."))
    if view.mailbox:
        lines.append(Line(f"{count(view.mailbox, 'unread message')}."))
    return Paragraph("now", tuple(lines))


def doing(memory: Memory, wanted: Callable[[IntentionView], bool] = lambda _: True) -> Iterator[Paragraph]:
    """Explain each wanted intention: goal, what it waits for and since when; equal ones are counted."""
    view = memory.view
    alike: dict[tuple[object, ...], list[IntentionView]] = {}
    for intention in filter(wanted, view.intentions):
        goals = ("".join(parts_of(event)[:2]) for event in intention.stack)
        shape = (*goals, intention.state, intention.waits_for, intention.at)
        alike.setdefault(shape, []).append(intention)
    for same in islice(alike.values(), MOST_INTENTIONS):
        lines = list(intention_lines(memory, same[0]))
        if len(same) > 1:
            lines.append(Line(f"And {count(len(same) - 1, 'more intention')} like it.", 1))
        yield Paragraph("now", tuple(lines), times=len(same))
    left = view.intentions_left_out + sum(map(len, islice(alike.values(), MOST_INTENTIONS, None)))
    if left > 0:
        yield Paragraph("now", (Line(f"And {count(left, 'more intention')}."),))


def intention_lines(memory: Memory, intention: IntentionView) -> Iterator[Line]:
    """Explain an intention: its position, purpose and cause."""
    stack = [event for event in intention.stack if event != ANSWERING]
    goals = [_goal(event) for event in stack]
    at = f" at {intention.at}" if intention.at else ""
    since = f" for {span(memory.now - intention.since)}" if intention.since is not None else ""
    match intention.state:
        case "waiting":
            what = f"has waited{since}" if since else "waits"
            what += awaited(intention.waits_for, " for ")
        case "suspended":
            what = f"is suspended{since}"
        case _:
            what = "goes on with the next formula"
    subject = first_up(goals[0]) if goals else f"Intention {intention.id}"
    yield Line(f"{subject} {what}{at}.", 0, intention.at)
    if len(goals) > 1:
        above = goals[1 : MOST_GOALS + 1]
        more = f", and {count(len(goals) - 1 - MOST_GOALS, 'more goal')} above" if len(goals) - 1 > MOST_GOALS else ""
        yield Line(f"It is for {', for '.join(above)}{more}.", 1)
    for made in memory.decisions:
        begins = not made.goal or made.goal == ANSWERING
        if begins and made.intention == intention.id and [without_annotations(made.event)] == stack[-1:]:
            yield from cause_lines(memory, made, goals[-1])
            return


def _goal(event: str) -> str:
    sign, rest = sign_of(without_annotations(event))
    return f"the failure plan of {sign[1:]}{shown(rest)}" if sign in ("-!", "-?") else raiser_text(event)


def dropped(memory: Memory, drops: tuple[DropView, ...]) -> Iterator[Paragraph]:
    """Explain what was dropped because queues were full."""
    for drop in drops:
        match drop.what:
            case "events":
                what = f"{count(drop.count, 'event')} {drop.name} {_was(drop.count)} dropped"
            case "messages":
                what = f"{count(drop.count, 'message')} of {drop.name or 'others'} {_was(drop.count)} dropped unread"
            case _:
                what = f"{count(drop.count, 'question')} of {drop.name or 'others'} got no answer"
        span_ = f", the first {ago(memory.now, drop.first)}" if drop.count > 1 else ""
        lines = [Line(f"{ago(memory.now, drop.last)}: {what}{span_}.")]
        if drop.reason:
            lines.append(Line(f"Why: {shown(drop.reason)}.", 1))
        if drop.what == "events":
            lines.append(Line("No plan was selected for them: the agent raises events faster than it handles them.", 1))
            lines += sites(memory, drop.name)
        yield Paragraph("dropped", tuple(lines), drop.last, drop.count)


def sites(memory: Memory, event: str) -> Iterator[Line]:
    """Return where in the program an event such as `+!tick/1` is raised."""
    sign, name = sign_of(event)
    uses = {f"{goal}{name}" for goal in ("!", "!!")} if sign == "+!" else {event}
    for plan in memory.view.plans:
        for use, place in plan.uses.items():
            if use in uses:
                yield Line(f"{use} is at {place}, in the plan {plan_text(plan)}.", 1, place)


def _was(count: int) -> str:
    return "was" if count == 1 else "were"


def only_counted(view: MindView) -> Iterator[Paragraph]:
    """Report drops of which only the number is known."""
    for what, number in view.dropped.items():
        named = sum(drop.count for drop in view.drops if drop.what == what)
        if number > named:
            more = " more" if named else ""
            yield Paragraph(
                "dropped", (Line(f"{number - named}{more} {what} were dropped because their queue was full."),)
            )


def failure_paragraph(memory: Memory, failure: FailureView) -> Paragraph:
    """Explain a failure whose decision is not remembered."""
    at = f" at {failure.position}" if failure.position else ""
    head = Line(f"{ago(memory.now, failure.time)}:{at} {failure_text(failure)}.", 0, failure.position)
    return Paragraph("failure", (head, *aftermath(memory, failure)), failure.time)
