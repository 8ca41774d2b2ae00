"""Goals without plans, and plans that no event reaches."""

from __future__ import annotations

from collections.abc import Iterator

from agentd.analysis.calls import arguments, finding, near
from agentd.analysis.mentions import PlacedPlan, Survey
from agentd.language.syntax import Plan, Structure, Variable
from schemas.findings import Finding


def goals_without_plans(survey: Survey) -> Iterator[Finding]:
    """Goals that the program sets itself and has no plan for, not even one for their failure."""
    if any(placed.name is None and "!" in placed.event for placed in survey.plans):
        return  # a plan +!G is for every goal
    achieving = {(placed.name, placed.arity) for placed in survey.plans if placed.event in ("+!", "-!")}
    names = {name for name, _ in achieving if name is not None}
    for goal in survey.achieved:
        if goal.indicator in achieving:
            continue
        others = [arity for name, arity in achieving if name == goal.name]
        hint = f"; there are plans for {goal.name} with {arguments(others)}" if others else near(goal.name, names)
        text = f"there is no plan for the goal !{goal.name}/{goal.arity}{hint}"
        if survey.open_plans:
            text += "; it fails unless a plan for it is added in time"
        yield finding(goal.position, text, warning=survey.open_plans)


def unreachable_plans(survey: Survey) -> Iterator[Finding]:
    """Plans behind one that takes every event which they could take."""
    for family in survey.families:
        takers: dict[tuple[str, str | None, int], PlacedPlan] = {}
        for placed in family:
            event = (placed.event, placed.name, placed.arity)
            taker = takers.get(event)
            if taker is not None:
                line = taker.plan.position.line
                name = f"{placed.event}{placed.name}/{placed.arity}"
                text = f"this plan is never used: the plan of line {line} takes every {name} before it"
                yield finding(placed.plan.position, text, warning=True)
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
