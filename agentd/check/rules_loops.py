"""Loops that never end and never wait, and asks that wait for ever."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from agentd.check.external_knowledge import Elsewhere
from agentd.check.finding_kinds import Kind, warning
from agentd.check.symbol_table import PlacedPlan, Survey, steps_of, takes_all
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.syntax_tree.traversal import is_labelled
from schemas.files.findings import Finding

_ASKS: Final = ("askOne", "askIf", "askAll", "askHow")

_INSTANT: Final = frozenset((".print", ".println", ".printf", ".log"))
"""Internal actions that neither wait nor fail; any other may end the loop."""

_CHANGES: Final = frozenset((Operator.ADD, Operator.ADD_FIRST, Operator.ADD_LAST, Operator.DELETE, Operator.UPDATE)) | {
    Operator.ADD_NEW_FOCUS,
    Operator.DELETE_NEW_FOCUS,
}


def busy_loops(survey: Survey, elsewhere: Elsewhere) -> Iterator[Finding]:
    """Find those that surely are: ``while (true)``, and a goal that its only plan sets again, with nothing to wait.

    What another intention or agent may end is none.
    """
    if survey.ends_goals or elsewhere.ends_goals:
        return
    events = {placed.name for placed in survey.plans if placed.event in ("+", "-")}
    for body in survey.bodies:
        for formula in body.formulas:
            match formula:
                case nodes.While(nodes.Structure("true", ()), inner, position) if _instant(inner.formulas, events):
                    yield _busy(position, "this loop never ends and never waits")
    for placed in survey.in_families():
        if _repeats(placed, survey, events):
            text = f"!{placed.name}/{placed.arity} sets itself again without end and never waits"
            yield _busy(placed.plan.position, text)


def _busy(position: nodes.Position, text: str) -> Finding:
    return warning(Kind.BUSY_LOOP, position, f"{text}; let it .wait for an event or a time")


def _instant(formulas: tuple[nodes.BodyFormula, ...], events: set[str | None]) -> bool:
    """Return whether formulas surely take no time and cannot fail: no goals, tests, or plans for what they change."""
    for formula in formulas:
        match formula:
            case nodes.Step(Operator.ACTION, nodes.InternalAction(name)):
                instant = name in _INSTANT
            case nodes.Step(operator, nodes.Structure(functor, namespace=None)) if operator in _CHANGES:
                instant = functor not in events and None not in events
            case nodes.Step(operator, nodes.RuleTerm() | nodes.PlanTerm()):
                instant = operator in _CHANGES
            case _:
                return False
        if not instant:
            return False
    return True


def _repeats(placed: PlacedPlan, survey: Survey, events: set[str | None]) -> bool:
    """Return whether a plan is the only one for its goal, has no context and ends by setting the goal again."""
    plan = placed.plan
    if placed.event != "+!" or plan.goal_condition is not None or not takes_all(plan) or not plan.body.formulas:
        return False
    rivals = [other for other in survey.plans if "!" in other.event and other.name in (None, placed.name)]
    alone = [other for other in rivals if other.name is None or other.indicator == placed.indicator] == [placed]
    match plan.body.formulas[-1]:
        case nodes.Step(Operator.ACHIEVE | Operator.ACHIEVE_NEW_FOCUS, nodes.Structure(functor, args, namespace=None)):
            again = functor == placed.name and len(args) == placed.arity
            return alone and again and _instant(plan.body.formulas[:-1], events)
    return False


def endless_asks(survey: Survey) -> Iterator[Finding]:
    """Synchronous asks of the agent itself in an atomic plan: it answers only when that plan has ended."""
    for plan in (placed.plan for placed in survey.plans if is_labelled(placed.plan, "atomic")):
        for step in steps_of(plan.body):
            match step.term:
                case nodes.InternalAction(".send", (nodes.Structure("self", ()), asked, _, _), position) if (
                    isinstance(asked, nodes.Structure) and asked.functor in _ASKS
                ):
                    text = "this ask never ends: the agent answers itself only when this atomic plan has ended; "
                    text += "give a time limit in ms as fifth argument of .send"
                    yield warning(Kind.ENDLESS_ASK, position, text)
