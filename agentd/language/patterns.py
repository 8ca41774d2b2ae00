"""Plan patterns, ``{ begin dg(g) } ... { end }``: how each rewrites the plans in its block.

``dg``: a declarative goal is achieved once it is believed, and checked after each plan (rule 104).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

from agentd.language import syntax
from agentd.language.syntax import Operator, Step

Pattern = Callable[[tuple[syntax.Term, ...], tuple[syntax.Plan, ...]], tuple[Any, ...]]


def _goal(args: tuple[syntax.Term, ...]) -> syntax.Structure:
    goal = args[0] if args else syntax.Structure("goal")
    return goal if isinstance(goal, syntax.Structure) else syntax.Structure("goal")


def _declarative(args: tuple[syntax.Term, ...], plans: tuple[syntax.Plan, ...]) -> tuple[Any, ...]:
    goal = _goal(args)
    already = syntax.Plan(syntax.Trigger("+", "!", goal, goal.position), goal, position=goal.position)
    return (already, *(_tested(plan, goal) for plan in plans))


def _tested(plan: syntax.Plan, goal: syntax.Structure) -> syntax.Plan:
    """A plan of the block that achieves the goal ends with a test of it."""
    trigger = plan.trigger
    if trigger.operator != "+" or trigger.goal != "!" or not isinstance(trigger.literal, syntax.Structure):
        return plan
    if trigger.literal.functor != goal.functor or len(trigger.literal.args) != len(goal.args):
        return plan
    test = Step(Operator.TEST, replace(trigger.literal, annotations=None), plan.position)
    return replace(plan, body=replace(plan.body, formulas=(*plan.body.formulas, test)))


PATTERNS: Final[dict[str, Pattern]] = {"dg": _declarative}
"""The patterns by name."""
