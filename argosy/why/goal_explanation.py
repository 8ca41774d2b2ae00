"""Explain one goal, belief or action of an agent."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from argosy.why.answer import Line, Paragraph
from argosy.why.current_state import doing, dropped, failure_paragraph
from argosy.why.decision_history import Memory
from argosy.why.decisions import WITHOUT_PLAN, aftermath, cause_lines, decision_paragraph, groups
from argosy.why.question import Subject, parts_of
from argosy.why.unanswered_questions import MailFacts, question_paragraph
from argosy.why.wording import ago, event_text, failure_text, plan_text, shown, sign_of
from schemas.files.findings import near_miss
from schemas.humanize import count, span
from schemas.wire.mind_records import ActivityEvent, BeliefView, FailureView, IntentionView, MindView, PlanView

MOST_BELIEFS = 5
MOST_PLANS = 6
MOST_SITES = 4
MOST_NAMES = 10


def about(memory: Memory, subject: Subject, last: int, facts: MailFacts) -> list[Paragraph]:
    """Return the paragraphs about a subject: its `last` events in order, then the present state and the program."""
    view = memory.view
    made = [one for one in memory.decisions if subject.is_of(one.event)]
    happened = [decision_paragraph(memory, group) for group in groups(made)]
    explained = [one.failure for one in made if one.failure is not None]
    failures = [one for one in memory.failures if subject.is_of(one.formula) and one.error not in WITHOUT_PLAN]
    happened += [
        paragraph
        for failure in _newest_of_each(failures)
        if failure not in explained and (paragraph := _failed(memory, failure)) is not None
    ]
    happened += list(dropped(memory, tuple(d for d in view.drops if d.what == "events" and subject.is_named(d.name))))
    happened += [
        question_paragraph(memory, one, facts)
        for one in view.questions
        if subject.is_of(one.content) or subject.name in (one.performative, ".send")
    ]
    happened += list(_performed(memory, subject, {failure.formula for failure in failures}))
    happened.sort(key=lambda paragraph: paragraph.time or 0.0)
    found = [*happened[-last:], *_intended(memory, subject), *_believed(memory, subject)]
    program = list(_program(memory, subject, bool(happened)))
    if not found and not program:
        return [Paragraph("hint", (Line(_unknown(view, subject)),))]
    return [*found, *program]


def _newest_of_each(failures: Iterable[FailureView]) -> list[FailureView]:
    newest: dict[tuple[str, str, str], FailureView] = {}
    for failure in failures:
        newest.pop(_reason(failure), None)
        newest[_reason(failure)] = failure
    return list(newest.values())


def _failed(memory: Memory, failure: FailureView) -> Paragraph:
    """Explain a formula that failed: its plan, the cause and the consequences."""
    at = f" at {failure.position}" if failure.position else ""
    made = memory.outcome_of(failure)
    if made is None or made.chosen is None:
        return failure_paragraph(memory, failure)
    same = sum(1 for one in memory.failures if _reason(one) == _reason(failure))
    lines = [
        Line(f"{ago(memory.now, failure.time)}:{at} {failure_text(failure)}.", 0, failure.position),
        Line(f"It is part of the plan {plan_text(made.chosen)} for {event_text(made.event)}.", 1, made.chosen.position),
        *cause_lines(memory, made, event_text(made.event)),
        *aftermath(memory, failure),
    ]
    if same > 1:
        lines.append(Line(f"The same {count(same - 1, 'time')} before.", 1))
    return Paragraph("failure", tuple(lines), failure.time, same)


def _reason(failure: FailureView) -> tuple[str, str, str]:
    return failure.position, failure.error, failure.reason


def _performed(memory: Memory, subject: Subject, failed: set[str]) -> Iterator[Paragraph]:
    """Explain actions and their outcomes, without those whose failure is explained already."""
    ends = {action.id: action for action in memory.view.actions if action.kind == "outcome"}
    for action in memory.view.actions:
        if action.kind != "action" or not subject.is_of(action.text):
            continue
        end = ends.get(action.id)
        if end is not None and end.state != "succeeded" and action.text in failed:
            continue
        places = [
            (place, plan) for plan in memory.view.plans for use, place in plan.uses.items() if _raises(subject, use)
        ]
        sites = [Line(f"It is at {at}, in the plan {plan_text(plan)}.", 1, at) for at, plan in places[:MOST_SITES]]
        yield Paragraph("action", (Line(_action(memory, action, end)), *sites), action.time)


def _action(memory: Memory, action: ActivityEvent, end: ActivityEvent | None) -> str:
    begun = f"{ago(memory.now, action.time)}: the action {shown(action.text)} started"
    if end is None:
        return f"{begun}; it has not ended."
    why = f": {shown(end.reason)}" if end.reason else ""
    how = end.state.replace("_", " ") if end.state in ("succeeded", "failed", "timed_out") else f"was {end.state}"
    return f"{begun}, and {end.time - action.time:.1f} s later it {how}{why}."


def _intended(memory: Memory, subject: Subject) -> Iterator[Paragraph]:
    def about_it(intention: IntentionView) -> bool:
        wait = intention.waits_for
        performs = wait is not None and wait.kind == "action" and subject.is_named(f"{wait.name}/{subject.arity or 0}")
        return performs or any(subject.is_of(event) for event in intention.stack)

    if any(map(about_it, memory.view.intentions)):
        yield from doing(memory, about_it)


def _believed(memory: Memory, subject: Subject) -> Iterator[Paragraph]:
    view = memory.view
    if subject.goal == "!":
        return
    beliefs = [belief for belief in view.beliefs if subject.is_of(belief.text)]
    lines = [Line(_belief(memory, belief)) for belief in beliefs[:MOST_BELIEFS]]
    if len(beliefs) > MOST_BELIEFS:
        lines.append(Line(f"And {count(len(beliefs) - MOST_BELIEFS, 'more belief')} of that name."))
    if beliefs and view.plans and not any(_fits(subject, plan, "+") for plan in view.plans):
        _, name, args = parts_of(beliefs[0].text)
        indicator = f"+{name}/{len(args)}"
        lines.append(Line(f"It is believed, but no plan is for {indicator}: nothing is done when it comes.", 1))
    if lines:
        yield Paragraph("belief", tuple(lines))


def _belief(memory: Memory, belief: BeliefView) -> str:
    origins = [{"percept": "perceived", "self": "the agent's own"}.get(who, f"told by {who}") for who in belief.sources]
    if belief.since is not None:
        origins.append(f"since mission second {belief.since:.1f} ({span(max(0.0, memory.now - belief.since))} ago)")
    return f"{shown(belief.text)} is believed now{': ' if origins else ''}{', '.join(origins)}."


def _program(memory: Memory, subject: Subject, happened: bool) -> Iterator[Paragraph]:
    """Name the plans for a subject, and the plans that raise it, if nothing has happened."""
    view = memory.view
    plans = [plan for plan in view.plans if _fits(subject, plan)]
    sites = [(plan, use, place) for plan in view.plans for use, place in plan.uses.items() if _raises(subject, use)]
    if happened or not (plans or sites):
        return
    lines: list[Line] = []
    if plans:
        named = [plan_text(plan) for plan in plans[:MOST_PLANS]]
        lines.append(Line(f"{count(len(plans), 'plan')} for it: {', '.join(named)}.", 0, plans[0].position))
    sign = subject.goal or (sign_of(plans[0].trigger)[0].lstrip("+-^") if plans else "")
    name = f"{sign}{subject.name}"
    remembered = f"none of the last {count(len(view.decisions), 'decision')}" if view.decisions else "no decision"
    lines.append(Line(f"{remembered[:1].upper()}{remembered[1:]} was about {name}.", 0))
    believed = any(subject.is_of(belief.text) for belief in view.beliefs)
    if not sign and not believed and any(sign_of(use)[0] for _, use, _ in sites):
        lines.append(Line("It is not believed now.", 0))
    if sites:
        for plan, use, place in sites[:MOST_SITES]:
            verb = "is" if sign_of(use)[0] else "is performed"
            lines.append(
                Line(f"{use} {verb} at {place}, in the plan {plan_text(plan)}, {_chosen(memory, plan)}", 1, place)
            )
    elif plans and not all(plan.trigger.startswith(("+!", "-!", "+?")) for plan in plans):
        lines.append(Line("No plan of the agent raises it: it must come as a percept or in a message.", 1))
    elif plans:
        lines.append(Line("No plan of the agent raises it: others must ask for it.", 1))
    yield Paragraph("plan", tuple(lines))


def _chosen(memory: Memory, plan: PlanView) -> str:
    """Return whether a plan was chosen, and if not why, as far as is remembered."""
    for made in reversed(memory.decisions):
        if made.chosen is not None and made.chosen.position == plan.position:
            return f"which was chosen {ago(memory.now, made.time)}."
        for one in made.rejected:
            if one.plan.position == plan.position:
                return f"which was not chosen {ago(memory.now, made.time)}: {shown(one.message)}."
    return "which was not chosen lately: nothing triggered it."


def _fits(subject: Subject, plan: PlanView, sign: str = "") -> bool:
    its, name, args = parts_of(plan.trigger)
    if name != subject.name or (subject.arity is not None and len(args) != subject.arity):
        return False
    return its == sign if sign else not subject.goal or subject.goal in its


def _raises(subject: Subject, use: str) -> bool:
    return subject.is_named(use) and (not subject.goal or subject.goal in sign_of(use)[0])


def names_of(view: MindView) -> list[str]:
    """Return the names of goals, beliefs and actions of the agent."""
    names = {made.name.rpartition("/")[0] for made in view.decisions}
    names |= {parts_of(plan.trigger)[1] for plan in view.plans}
    names |= {sign_of(use)[1].rpartition("/")[0] for plan in view.plans for use in plan.uses}
    names |= {parts_of(belief.text)[1] for belief in view.beliefs}
    names |= {parts_of(action.text)[1] for action in view.actions}
    return sorted(name for name in names if name)


def _unknown(view: MindView, subject: Subject) -> str:
    names = names_of(view)
    if subject.name in names:
        return f"Nothing is remembered of {subject.text}, and nothing is believed about it."
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    hint = f"; known are {', '.join(names[:MOST_NAMES])}{more}." if names else ": no goal, belief or action."
    return f"{view.agent} has nothing called `{subject.name}`{near_miss(subject.name, names) or hint}"
