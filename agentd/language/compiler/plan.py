"""Generates the Python of a plan: one function that selects it (`compile_select`), one per formula of its body.

Nothing here belongs to a mind: references to predicates, plans and steps are `Ref` constants, provided when a mind
loads the code.
"""

from __future__ import annotations

from typing import Any

from agentd.language.compiler.body import BodyCompiler
from agentd.language.compiler.code_writer import Function, Unit
from agentd.language.compiler.compile_terms import Scope
from agentd.language.compiler.formulas import FormulaCompiler
from agentd.language.compiler.plan_code import FRAME_HEADER, PlanCode, StepCode
from agentd.language.compiler.selection import Form, compile_select
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import variables


def compile_plan(
    plan: nodes.Plan, library: Any, values: dict[str, Any], outer: dict[str, int] | None = None, form: Form = "select"
) -> PlanCode:
    """The code of a plan. ``values`` are the variables that were bound when the plan was made as a term.

    ``form`` is that of the function that selects it.

    For a nested plan ``outer`` gives the places, in the frame of the plan around it, of the variables that it sees.
    """
    unit = Unit(f"plan at {plan.position}")
    code = PlanCode(unit, {})
    for name in variables((plan.trigger.literal, plan.context, plan.goal_condition, plan.body)):
        code.slot(name)
    for name in values:
        code.slot(name)
    for name in outer or {}:
        code.slot(name)
    bound = compile_select(form, plan, code, library, values, outer or {})
    code.bound = dict.fromkeys(bound, True)
    code.first = BodyCompiler(code, library).body(plan.body, dict(code.bound), None)
    if plan.goal_condition is not None:
        _compile_condition(plan, code, library)
    return code


def _compile_condition(plan: nodes.Plan, code: PlanCode, library: Any) -> None:
    """``condition(m, trail, f)``: whether the goal condition holds in a frame of the plan."""
    function = Function(code.unit, "condition", "m, trail, f")
    scope: Scope = {}
    for name in variables(plan.goal_condition):
        if code.bound.get(name):
            scope[name] = function.assign(f"f[{code.slot(name)}]")
    compiler = FormulaCompiler(code.unit, function, library, "")
    compiler.formula(plan.goal_condition, scope, lambda _: function.emit("return True"))
    function.emit("return False")
    code.unit.add(function)


def compile_fragment(
    body: nodes.Body, library: Any, values: dict[str, Any], slots: dict[str, int], size: int
) -> PlanCode:
    """The code of a body held by a variable, to run in a frame with these places for variables."""
    code = PlanCode(Unit(f"body at {body.position}"), dict(slots), size=max(size, FRAME_HEADER))
    for name in variables(body):
        code.slot(name)
    compiler = BodyCompiler(code, library)
    compiler.values = values
    code.steps.append(StepCode("", None))  # stands for the step that follows in the frame
    code.first = compiler.body(body, dict.fromkeys(code.slots, False), 0)
    return code


def compile_formula(formula: Any, library: Any) -> Unit:
    """A unit with ``holds(m, trail)``: whether a formula over the beliefs has a solution."""
    unit = Unit("formula")
    function = Function(unit, "holds", "m, trail")
    compiler = FormulaCompiler(unit, function, library, "")
    compiler.formula(formula, {}, lambda _: function.emit("return True"))
    function.emit("return False")
    unit.add(function)
    return unit
