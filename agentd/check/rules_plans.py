"""Goals without plans, plans that no event reaches, labels that stand twice."""

from __future__ import annotations

from collections.abc import Iterator

from agentd.check.external_knowledge import Elsewhere, arguments
from agentd.check.finding_kinds import Kind, finding, warning
from agentd.check.symbol_table import PlacedPlan, Survey
from agentd.language.errors.suggestions import near
from agentd.language.syntax_tree.nodes import Plan, Structure, Variable
from schemas.files.findings import Finding


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
                text = f"this plan is never used: the plan of line {line} takes every {name} before it"
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
                    continue  # told where the goal stands, with this plan's name
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
    text = f"this plan is never used, unless by what others send: {why}{hint}"
    return warning(Kind.PLAN_NEVER_USED, placed.plan.trigger.position, text)


def duplicate_labels(survey: Survey) -> Iterator[Finding]:
    """Labels that stand before two plans: whoever asks for the plan of this label gets one of them."""
    first: dict[tuple[str, int], Plan] = {}
    for family in survey.families:
        for placed in family:
            label = placed.plan.label
            if not isinstance(label, Structure) or not label.functor:
                continue
            before = first.setdefault((f"{label.namespace}::{label.functor}", len(label.args)), placed.plan)
            same_file = before.position.file == placed.plan.position.file
            if before is not placed.plan and same_file and before.position != placed.plan.position:
                text = f"the label {label.functor} stands before the plan of line {before.position.line} too"
                yield warning(Kind.DUPLICATE_LABEL, label.position, text)
