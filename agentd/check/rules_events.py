"""Beliefs and goals that are used but never added or planned for, plans that no event reaches, duplicate labels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from agentd.check.external_knowledge import RAISED_BY_AGENTD, Arities, Elsewhere, arguments, takes
from agentd.check.finding_kinds import Kind, finding, warning
from agentd.check.symbol_table import Mention, PlacedPlan, Survey, takes_all
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import near
from agentd.language.syntax_tree.traversal import is_labelled, misspelt_words
from schemas.files.findings import Finding

_TRUTH = {("true", 0), ("false", 0)}


def beliefs_never_added(survey: Survey, percepts: Arities | None, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Tests of beliefs that are no percept and that no line adds.

    Beliefs that another agent may send look the same, and a program may be written for several robots, so these are
    warnings. If the percepts are not known, only probable misspellings are reported.
    """
    held = _held(survey, elsewhere.beliefs)
    programs_own = held - RAISED_BY_AGENTD
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
        hint = _hint(test.name, programs_own, percepts or ())
        if known or (hint and _base(test.name) not in {_base(name) for name, _ in programs_own}):
            belief, consequence = f"{test.name}/{test.arity}", _consequence(test, tested_as_goal)
            if percepts is not None:
                text = f"no percept has its name: {consequence} unless an agent or the mission adds it"
                text = f"nothing adds the belief {belief} and {text}{hint}"
            else:
                text = f"{consequence} unless it is a percept or an agent sends it"
                text = f"nothing adds the belief {belief}: {text}{hint}"
            yield warning(Kind.BELIEF_NEVER_ADDED, test.position, text)


def events_never_perceived(survey: Survey, percepts: Arities, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Yield plans for a percept with a number of arguments that it does not have, or for what is no percept."""
    added = {mention.indicator for mention in (*survey.added, *survey.raised)} | elsewhere.beliefs | RAISED_BY_AGENTD
    for placed in survey.in_families():
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
    """Return a name without its namespace."""
    return name.rpartition("::")[2]


def _consequence(test: Mention, tested_as_goal: bool) -> str:
    arguments_written = f"({','.join('_' * test.arity)})" if test.arity else ""
    literal = f"{test.name}{arguments_written}"
    if tested_as_goal:
        return f"?{literal} always fails"
    return f"not {literal} is always true" if test.inverted else f"{literal} is always false"


def _hint(
    name: str, known: Iterable[tuple[str | None, int]], names: Iterable[str] = (), there: str = "there is"
) -> str:
    """Return what else there is of a name with a wrong number of arguments, or a name like it."""
    known = list(known)
    if others := [arity for other, arity in known if other == name]:
        return f"; {there} {name} with {arguments(others)}"
    return near(name, {*(other for other, _ in known if other is not None), *names})


def goals_without_plans(survey: Survey, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Goals that the program sets and has no plan for; with one for their failure, only if a plan nearly fits."""
    if any(placed.name is None and "!" in placed.event for placed in survey.plans):
        return  # a plan +!G is for every goal
    achieving, failing = (
        {placed.indicator for placed in survey.plans if placed.event == event} for event in ("+!", "-!")
    )
    for goal in survey.achieved:
        if goal.indicator in achieving:
            continue
        hint = _hint(goal.name, achieving, there="there are plans for")
        if goal.indicator in failing:
            if hint:
                text = f"there is no plan +!{goal.name}/{goal.arity}, only one for its failure{hint}"
                yield warning(Kind.GOAL_WITHOUT_PLAN, goal.position, text)
            continue
        text = f"there is no plan for the goal !{goal.name}/{goal.arity}{hint}"
        if survey.open_plans or elsewhere.open_plans:
            text += "; it fails unless a plan for it is added in time"
            yield warning(Kind.GOAL_WITHOUT_PLAN, goal.position, text)
        else:
            yield finding(Kind.GOAL_WITHOUT_PLAN, goal.position, text)


def shadowed_plans(survey: Survey) -> Iterator[Finding]:
    """Yield plans behind one that takes every event which they could take, unless plans are looked at or removed."""
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
            elif placed.name is not None and takes_all(placed.plan):
                takers[event] = placed


def unused_plans(survey: Survey, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Yield plans for goals that nobody sets, for their failures, and for beliefs that nobody adds."""
    goals = {mention.indicator for mention in (*survey.achieved, *survey.raised)} | elsewhere.goals
    passive = not survey.achieved  # a library, or an agent that others ask for all that it does
    open_goals = survey.open_goals or elsewhere.open_goals or survey.looks_at_plans
    open_goals = open_goals or passive or not elsewhere.complete
    planned = {placed.indicator for placed in survey.plans if placed.event == "+!"}
    lost = {goal.name for goal in survey.achieved if goal.indicator not in planned}
    for placed in () if open_goals else survey.in_families():
        if placed.name is None or is_labelled(placed.plan, "test") or placed.names_source:
            continue
        if placed.event == "-!" and placed.indicator not in goals | planned:
            yield _unused(placed, f"there is no plan +!{placed.name}/{placed.arity}", planned)
        elif placed.event == "+!" and placed.indicator not in goals:
            if placed.name in lost or near(placed.name, lost):
                continue  # reported at the goal, with this plan's name
            yield _unused(placed, f"nothing sets the goal !{placed.name}/{placed.arity}", goals)


def unused_belief_plans(survey: Survey, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Yield plans for beliefs that nobody adds, where it is known that there are no percepts."""
    closed = elsewhere.complete and not (survey.open_beliefs or elsewhere.open_beliefs)
    if not closed or not elsewhere.no_percepts or survey.actions:
        return
    added = {mention.indicator for mention in (*survey.added, *survey.raised)}
    for placed in survey.in_families():
        if placed.event not in ("+", "-") or placed.name is None or placed.names_source:
            continue
        if placed.indicator not in added | elsewhere.beliefs:
            yield _unused(placed, f"nothing adds the belief {placed.name}/{placed.arity}", added)


def _unused(placed: PlacedPlan, why: str, known: Iterable[tuple[str | None, int]]) -> Finding:
    text = f"this plan is never used unless others send its event: {why}{_hint(placed.name or '', known)}"
    return warning(Kind.PLAN_NEVER_USED, placed.plan.trigger.position, text)


def duplicate_labels(survey: Survey) -> Iterator[Finding]:
    """Labels that two plans have: an internal action that takes a label finds only one of them."""
    first: dict[tuple[str, int], nodes.Plan] = {}
    for placed in survey.in_families():
        label = placed.plan.label
        if not isinstance(label, nodes.Structure) or not label.functor:
            continue
        before = first.setdefault((f"{label.namespace}::{label.functor}", len(label.args)), placed.plan)
        same_file = before.position.file == placed.plan.position.file
        if before is not placed.plan and same_file and before.position != placed.plan.position:
            text = f"the plan in line {before.position.line} has the label {label.functor} too"
            yield warning(Kind.DUPLICATE_LABEL, label.position, text)


def misspelt_labels(survey: Survey) -> Iterator[Finding]:
    """Yield annotations of labels that are nearly one with a meaning: the test is not run, the plan not atomic."""
    for placed in survey.plans:
        for word, meant in misspelt_words(placed.plan):
            text = f"`[{word.functor}]` has no meaning in the label of a plan, did you mean `[{meant}]`?"
            yield warning(Kind.MISSPELT_ANNOTATION, word.position, text)
