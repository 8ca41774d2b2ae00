"""Generates the Python of a plan: one function that selects it (trigger and context), one per formula of its body.

Nothing here belongs to a mind: references to predicates, plans and steps are `Ref` constants, provided when a mind
loads the code.
"""

from __future__ import annotations

from typing import Any

from agentd.language import syntax
from agentd.language.compile_body import BodyCompiler
from agentd.language.compile_formula import FormulaCompiler
from agentd.language.compile_terms import Scope
from agentd.language.emit import Function, Ref, Unit
from agentd.language.plan_code import FRAME_HEADER, PlanCode, StepCode
from agentd.language.variables import is_plain_variable, variables


def compile_plan(
    plan: syntax.Plan, library: Any, values: dict[str, Any], outer: dict[str, int] | None = None
) -> PlanCode:
    """The code of a plan. ``values`` are the variables that were bound when the plan was made as a term.

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
    bound = _compile_select(plan, code, library, values, outer or {})
    code.bound = dict.fromkeys(bound, True)
    code.first = BodyCompiler(code, library).body(_without_leading_true(plan.body), dict(code.bound), None)
    if plan.goal_condition is not None:
        _compile_condition(plan, code, library)
    return code


def _compile_condition(plan: syntax.Plan, code: PlanCode, library: Any) -> None:
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
    body: syntax.Body, library: Any, values: dict[str, Any], slots: dict[str, int], size: int
) -> PlanCode:
    """The code of a body held by a variable, to run in a frame with these places for variables."""
    code = PlanCode(Unit(f"body at {body.position}"), dict(slots), size=max(size, FRAME_HEADER))
    for name in variables(body):
        code.slot(name)
    compiler = BodyCompiler(code, library)
    compiler.values = values
    code.steps.append(StepCode("", None))  # stands for the step that follows in the frame
    code.first = compiler.body(_without_leading_true(body), dict.fromkeys(code.slots, False), 0)
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


def _without_leading_true(body: syntax.Body) -> syntax.Body:
    """``true`` at the very start of a body does nothing (rule 64)."""
    match body.formulas:
        case (syntax.Step(operator=syntax.Operator.ACTION, term=syntax.Structure(functor="true", args=())), *_):
            return syntax.Body(body.formulas[1:], body.position)
    return body


def _compile_select(
    plan: syntax.Plan, code: PlanCode, library: Any, values: dict[str, Any], outer: dict[str, int]
) -> list[str]:
    """``select(m, trail, relevant, args, annots)``: a new frame, or None if the plan is not applicable.

    Returns the variables that the frame has values for.
    """
    unit = code.unit
    function = Function(unit, "select", "m, trail, relevant, args, annots" + ", around=None")
    compiler = FormulaCompiler(unit, function, library, "")
    scope: Scope = {name: unit.constant(value) for name, value in values.items()}
    for name, place in outer.items():
        local = function.assign(f"around[{place}]")
        with function.block(f"if {local} is None:"):
            function.emit(f"{local} = Var({unit.constant(name)})")
        scope[name] = local
    bound: list[str] = []

    def selected(found: Scope) -> None:
        bound[:] = [name for name in code.slots if name in found]
        places = ["None"] * (code.size - FRAME_HEADER)
        for name in bound:
            places[code.slots[name] - FRAME_HEADER] = found[name]
        first = unit.constant(Ref("first", None))
        here = unit.constant(Ref("plan", None))
        header = [first, here, "relevant", "args", "annots", "0"]
        function.emit(f"return [{', '.join(header + places)}]")

    def context(found: Scope) -> None:
        if plan.context is None:
            selected(found)
        else:
            compiler.formula(plan.context, found, selected)

    def annots(found: Scope) -> None:
        literal = plan.trigger.literal
        pattern = literal.annotations
        if pattern is None or (not pattern.items and pattern.tail is None):
            context(found)
        else:
            compiler.match_annots(pattern, "annots", found, context)

    literal = plan.trigger.literal
    if isinstance(literal, syntax.Structure):
        names = [f"a{i}" for i in range(len(literal.args))]
        if names:
            function.emit(f"({', '.join(names)},) = args")
        compiler.match_all(list(zip(literal.args, names, strict=True)), scope, annots)
    else:
        whole = function.assign("Literal(relevant.sig, args, annots)")
        if is_plain_variable(literal):
            compiler.match(literal, function.assign(f"{whole}.bare()"), scope, context)
        else:
            compiler.match(literal, whole, scope, context)
    function.emit("return None")
    # The size of a frame may still grow by hidden places of the body, which are appended when they are first used.
    unit.add(function)
    return bound
