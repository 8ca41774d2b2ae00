"""Beliefs and goals that are used but never added or planned for, plans that no event reaches, duplicate labels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from agentd.check.external_knowledge import RAISED_BY_AGENTD, Arities, Elsewhere, arguments, takes
from agentd.check.finding_kinds import Kind, finding, warning
from agentd.check.symbol_table import Mention, PlacedPlan, Survey
from agentd.language.errors.suggestions import near
from agentd.language.syntax_tree.nodes import Plan, Structure, Variable
from schemas.files.findings import Finding

_TRUTH = {("true", 0), ("false", 0)}


def beliefs_never_added(survey: Survey, percepts: Arities | None, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Tests of beliefs that are no percept and that no line adds.

    Beliefs that another agent may send look the same, and a program may be written for several robots, so these are
    warnings. If the percepts are not known, only probable misspellings are reported.
    """
    held = _held(survey, elsewhere.beliefs)
    by_name: dict[str, set[int]] = {}
    for name, arity in held - RAISED_BY_AGENTD:
        by_name.setdefault(name, set()).add(arity)
    known = percepts is not None or (elsewhere.complete and elsewhere.no_percepts and not survey.actions)
    for test, tested_as_goal in [*((m, False) for m in survey.tested), *((m, True) for m in survey.asked)]:
        if test.indicator in held or test.from_others or test.indicator in _TRUTH:
            continue
        perceived = percepts.get(test.name) if percepts is not None else None
        if perceived is not None:
            if not takes(perceived, test.arity):
                text = f"the percept {test.name} has {arguments(perceived)}, not {test.arity}"
                text = f"{text}: {_consequence(test, tested_as_goal)}"
                yield warning(Kind.PERCEPT_ARITY, test.position, text)
            continue
        if survey.open_beliefs or elsewhere.open_beliefs:
            continue
        hint = _hint(test, by_name, percepts)
        if known or (hint and _base(test.name) not in map(_base, by_name)):
            belief, consequence = f"{test.name}/{test.arity}", _consequence(test, tested_as_goal)
            if percepts is not None:
                text = f"no percept has its name: {consequence} unless an agent or the mission adds it"
                text = f"nothing adds the belief {belief} and {text}{hint}"
            else:
                text = f"{consequence} unless it is a percept or an agent sends it"
                text = f"nothing adds the belief {belief}: {text}{hint}"
            yield warning(Kind.BELIEF_NEVER_ADDED, test.position, text)


def events_never_perceived(survey: Survey, percepts: Arities, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Plans for a percept with a number of arguments that it does not have, or for what is no percept."""
    added = {mention.indicator for mention in (*survey.added, *survey.raised)} | elsewhere.beliefs | RAISED_BY_AGENTD
    for placed in (plan for family in survey.families for plan in family):
        if placed.event not in ("+", "-") or placed.name is None or placed.indicator in added or placed.names_source:
            continue
        arities = percepts.get(placed.name)
        place = placed.plan.trigger.position
        if arities is None:
            if not (survey.open_beliefs or elsewhere.open_beliefs):
                text = f"nothing adds the belief {placed.name}/{placed.arity} and no percept has its name: "
                text += f"this plan never runs unless an agent or the mission adds it{near(placed.name, percepts)}"
                yield warning(Kind.UNKNOWN_PERCEPT, place, text)
        elif not takes(arities, placed.arity):
            text = f"the percept {placed.name} has {arguments(arities)}, not {placed.arity}: this plan never runs"
            yield warning(Kind.PERCEPT_ARITY, place, text)


def _held(survey: Survey, beliefs: Iterable[tuple[str, int]]) -> set[tuple[str, int]]:
    """Return the beliefs that are possible by the program; a plan +b means that b is expected from elsewhere."""
    held = {mention.indicator for mention in survey.added} | set(beliefs)
    for placed in survey.plans:
        if placed.event in ("+", "+?") and placed.name is not None:
            held.add((placed.name, placed.arity))
    return held


def _base(name: str) -> str:
    """A name without its namespace."""
    return name.rpartition("::")[2]


def _consequence(test: Mention, tested_as_goal: bool) -> str:
    arguments_written = f"({','.join('_' * test.arity)})" if test.arity else ""
    literal = f"{test.name}{arguments_written}"
    if tested_as_goal:
        return f"?{literal} always fails"
    return f"not {literal} is always true" if test.inverted else f"{literal} is always false"


def _hint(test: Mention, by_name: dict[str, set[int]], percepts: Arities | None) -> str:
    if test.name in by_name:
        return f"; there is {test.name} with {arguments(by_name[test.name])}"
    return near(test.name, {*by_name, *(percepts or ())})


def goals_without_plans(survey: Survey, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Goals that the program sets itself and has no plan for, not even one for their failure."""
    if any(placed.name is None and "!" in placed.event for placed in survey.plans):
        return  # a plan +!G is for every goal
    achieving = {placed.indicator for placed in survey.plans if placed.event in ("+!", "-!")}
    names = {name for name, _ in achieving if name is not None}
    for goal in survey.achieved:
        if goal.indicator in achieving:
            continue
        others = [arity for name, arity in achieving if name == goal.name]
        hint = f"; there are plans for {goal.name} with {arguments(others)}" if others else near(goal.name, names)
        text = f"there is no plan for the goal !{goal.name}/{goal.arity}{hint}"
        if survey.open_plans or elsewhere.open_plans:
            text += "; it fails unless a plan for it is added in time"
            yield warning(Kind.GOAL_WITHOUT_PLAN, goal.position, text)
        else:
            yield finding(Kind.GOAL_WITHOUT_PLAN, goal.position, text)


def shadowed_plans(survey: Survey) -> Iterator[Finding]:
    """Plans behind one that takes every event which they could take, unless plans are looked at or removed."""
    if survey.looks_at_plans:
        return
    for family in survey.families:
        takers: dict[tuple[str, str | None, int], PlacedPlan] = {}
        for placed in family:
            event = (placed.event, placed.name, placed.arity)
            taker = takers.get(event)
            if taker is not None:
                line = taker.plan.position.line
                name = f"{placed.event}{placed.name}/{placed.arity}"
                text = f"this plan is never used: the plan in line {line} takes every {name} before it"
                yield warning(Kind.PLAN_SHADOWED, placed.plan.position, text)
            elif placed.name is not None and _takes_all(placed.plan):
                takers[event] = placed


def _takes_all(plan: Plan) -> bool:
    """Whether a plan is relevant and applicable for every event of its name and arity."""
    literal = plan.trigger.literal
    if not isinstance(literal, Structure) or literal.annotations is not None or isinstance(literal.namespace, Variable):
        return False
    if plan.context is not None and plan.context != Structure("true"):
        return False
    names = [arg.name for arg in literal.args if isinstance(arg, Variable) and arg == Variable(arg.name)]
    named = [name for name in names if not name.startswith("_")]
    return len(names) == len(literal.args) and len(set(named)) == len(named)


def unused_plans(survey: Survey, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Plans for goals that nobody sets, for their failures, and for beliefs that nobody adds."""
    goals = {mention.indicator for mention in (*survey.achieved, *survey.raised)} | elsewhere.goals
    passive = not survey.achieved  # a library, or an agent that others ask for all that it does
    open_goals = not elsewhere.complete or passive or survey.open_goals or elsewhere.open_goals
    open_goals = open_goals or survey.looks_at_plans
    planned = {placed.indicator for placed in survey.plans if placed.event == "+!"}
    lost = {goal.name for goal in survey.achieved if goal.indicator not in planned}
    for family in survey.families:
        for placed in family:
            if placed.name is None or placed.is_test or placed.names_source:
                continue
            if placed.event == "-!" and not open_goals and placed.indicator not in goals | planned:
                yield _unused(placed, f"there is no plan +!{placed.name}/{placed.arity}", planned)
            elif placed.event == "+!" and not open_goals and placed.indicator not in goals:
                if placed.name in lost or near(placed.name, lost):
                    continue  # reported at the goal, with this plan's name
                yield _unused(placed, f"nothing sets the goal !{placed.name}/{placed.arity}", goals)


def unused_belief_plans(survey: Survey, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Plans for beliefs that nobody adds, where it is known that there are no percepts."""
    if (
        not elsewhere.complete
        or not elsewhere.no_percepts
        or survey.actions
        or survey.open_beliefs
        or elsewhere.open_beliefs
    ):
        return
    added = {mention.indicator for mention in (*survey.added, *survey.raised)}
    for family in survey.families:
        for placed in family:
            if placed.event not in ("+", "-") or placed.name is None or placed.names_source:
                continue
            if placed.indicator not in added | elsewhere.beliefs:
                yield _unused(placed, f"nothing adds the belief {placed.name}/{placed.arity}", added)


def _unused(placed: PlacedPlan, why: str, known: set[tuple[str | None, int]] | set[tuple[str, int]]) -> Finding:
    others = [arity for name, arity in known if name == placed.name]
    if others:
        hint = f"; there is {placed.name} with {arguments(others)}"
    else:
        hint = near(placed.name or "", {name for name, _ in known if name is not None})
    text = f"this plan is never used unless others send its event: {why}{hint}"
    return warning(Kind.PLAN_NEVER_USED, placed.plan.trigger.position, text)


def duplicate_labels(survey: Survey) -> Iterator[Finding]:
    """Labels that two plans have: an internal action that takes a label finds only one of them."""
    first: dict[tuple[str, int], Plan] = {}
    for family in survey.families:
        for placed in family:
            label = placed.plan.label
            if not isinstance(label, Structure) or not label.functor:
                continue
            before = first.setdefault((f"{label.namespace}::{label.functor}", len(label.args)), placed.plan)
            same_file = before.position.file == placed.plan.position.file
            if before is not placed.plan and same_file and before.position != placed.plan.position:
                text = f"the plan in line {before.position.line} has the label {label.functor} too"
                yield warning(Kind.DUPLICATE_LABEL, label.position, text)
