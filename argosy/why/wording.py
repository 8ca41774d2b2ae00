"""Events, plans, failures and times as text for people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from schemas.humanize import shortened, some, span
from schemas.wire.mind_records import FailureView, PlanView, RejectedView, WaitView

ANSWERING = "+!answer_question"
"""The internal event of an intention that answers a question of another agent."""
LONGEST = 160
"""Characters of a formula that are shown."""
MOST_GOALS = 4
"""Goals that a line names."""


def shown(text: str) -> str:
    """Return a text of an agent, printable and at most `LONGEST` characters long."""
    return shortened(text, LONGEST)


def ago(now: float, then: float) -> str:
    """Return `12 s ago (mission second 431.2)`; for a future time `in 12 s (...)`. Both are in mission seconds."""
    seconds = now - then
    where = f"mission second {then:.1f}"
    if seconds < -0.05:
        return f"in {span(-seconds)} ({where})"
    return f"{span(seconds)} ago ({where})" if seconds >= 0.05 else f"now ({where})"


def first_up(text: str) -> str:
    """Return the text as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def unquoted(text: str) -> Iterator[tuple[int, str]]:
    """Yield the characters of a term outside strings and quoted names, each with its index."""
    quote, escaped = "", False
    for place, character in enumerate(text):
        if escaped:
            escaped = False
        elif quote:
            escaped = character == "\\"
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        else:
            yield place, character


def without_annotations(text: str) -> str:
    """Return an event without its annotations: `+!go(1)` of `+!go(1)[source(bob)]`."""
    depth = 0
    for place, character in unquoted(text):
        if character == "(":
            depth += 1
        elif character == ")":
            depth -= 1
        elif character == "[" and depth == 0:
            return text[:place]
    return text


def sign_of(event: str) -> tuple[str, str]:
    """Operator and kind of an event, and the rest: `+!` and `go(1)`."""
    rest = event.lstrip("+-^!?")
    return event[: len(event) - len(rest)], rest


def event_text(event: str) -> str:
    """Return an event as text: `the goal !go(1)`, `the new belief victim(3)`."""
    sign, rest = sign_of(without_annotations(event))
    rest = shown(rest)
    match sign:
        case "+!":
            return f"the goal !{rest}"
        case "-!":
            return f"the failure of !{rest}"
        case "+?":
            return f"the question ?{rest}"
        case "-?":
            return f"the failure of ?{rest}"
        case "+":
            return f"the new belief {rest}"
        case "-":
            return f"the end of the belief {rest}"
    return f"the event {sign}{rest}"


def goal_text(event: str) -> str:
    """Return the event of a plan as the goal it is for: `!go(1)` of `+!go(1)`."""
    sign, rest = sign_of(without_annotations(event))
    return f"{sign.removeprefix('+') if sign in ('+!', '+?') else sign}{shown(rest)}"


def raiser_text(event: str) -> str:
    """Return the event of a plan that raised another one: the goal it is for, or what happened."""
    return goal_text(event) if sign_of(event)[0] in ("+!", "+?") else event_text(event)


def goals_text(events: Iterable[str]) -> str:
    """Return several goals, the innermost first; of many the number."""
    return some([goal_text(event) for event in events], MOST_GOALS)


def plan_text(plan: PlanView) -> str:
    """Return a plan with its label and place: `@careful +!fly(H) (fly.asl:4)`."""
    label = f"@{plan.label} " if plan.label else ""
    return f"{shown(label + plan.trigger)} ({plan.position})" if plan.position else shown(label + plan.trigger)


def with_values(bindings: Mapping[str, str]) -> str:
    """Return values as `, with B = 12`."""
    pairs = [f"{name} = {value}" for name, value in bindings.items()]
    return f", with {shown(', '.join(pairs))}" if pairs else ""


def awaited(wait: WaitView | None, before: str) -> str:
    """Return what an intention waits for, after `before`; empty if it waits for nothing."""
    return "" if wait is None else before + _awaited(wait)


def _awaited(wait: WaitView) -> str:
    match wait.kind:
        case "action":
            return f"the action {shown(wait.name)}"
        case "answer":
            return f"the answer of {shown(', '.join(wait.agents))}"
        case "time":
            return f"{wait.seconds or 0.0:g} s to pass (.wait)"
        case "formula":
            return "a condition to hold (.wait)"
        case "event":
            return "an event to happen (.wait)"
        case "plan":
            return f"a plan for {goal_text(wait.name)}"
        case "goal_condition":
            return "the condition of its goal to hold"
        case "fork":
            return "the branches of its fork"
        case "team":
            return f"the request {shown(wait.name)}"
    return shown(wait.name)


def rejected_text(rejected: RejectedView) -> str:
    """Return why a plan was not chosen."""
    if rejected.why != "context" or not rejected.literal:
        return rejected.message
    return f"{shown(rejected.literal)} does not hold{with_values(rejected.plan.bindings)}"


def failure_text(failure: FailureView) -> str:
    """Return what failed, and why: `the action takeoff(5) failed: it is not armed`."""
    what = shown(failure.formula)
    why = f": {shown(failure.reason)}" if failure.reason else ""
    match failure.error:
        case "constraint_failed":
            return f"{what} did not hold"
        case "test_goal_failed":
            return f"{what} matches no belief"
        case "no_relevant":
            return f"there is no plan for {event_text(failure.formula)}"
        case "no_applicable":
            return f"no plan was applicable for {event_text(failure.formula)}"
        case "wait_timeout":
            return f"{what} timed out"
        case "action_failed" if not what.startswith("."):
            return f"the action {what} failed{why}"
        case "ia_failed":
            return f"{what} did not succeed{why}"
        case "undefined_number":
            return f"{what} could not be computed{why}"
    return f"{what} failed with the error {failure.error}{why}"
