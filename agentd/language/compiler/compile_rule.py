"""Generates the Python of a rule for one mode of calling it: which arguments are given, which are asked for."""

from __future__ import annotations

from typing import Any

from agentd.language.compiler.code_writer import Function, Unit, tuple_of
from agentd.language.compiler.compile_terms import Scope
from agentd.language.compiler.formulas import FormulaCompiler
from agentd.language.syntax_tree import nodes

STEPS = 2
"""Steps of work for which a rule that is asked counts (`agentd.mind.beliefs.work_limit`)."""


def compile_rule(rule: nodes.Rule, mode: tuple[bool, ...], library: Any, values: dict[str, Any]) -> Unit:
    """A unit with the generator ``answers(m, trail, *args)``.

    Each answer is the tuple of the head's arguments; a mode one longer than the head asks for its annotations as well.
    ``values`` holds what variables of the rule were bound to when it was made at run time.
    """
    head = rule.head
    unit = Unit(f"rule {head.functor}/{len(head.args)} at {rule.position}")
    parameters = [f"a{i}" for i in range(len(head.args))]
    function = Function(unit, "answers", ", ".join(["m", "trail", *parameters]))
    compiler = FormulaCompiler(unit, function, library, "")
    compiler.nested = True
    scope: Scope = {name: unit.constant(value) for name, value in values.items()}
    annotated = len(mode) > len(head.args)
    function.emit(f"m.steps_left -= {STEPS}")
    function.emit("if m.steps_left < 0: too_much_work(m)")
    function.emit("mark = len(trail)")

    def answer(found: Scope) -> None:
        inner = dict(found)
        out = [
            parameter if given else compiler.build(arg, inner)
            for parameter, given, arg in zip(parameters, mode, head.args, strict=False)
        ]
        if annotated:
            out.append(compiler.annots(head.annotations, inner))
        answered = tuple_of(out) if out else "()"
        # Who asked frees what has been bound before asking for the next answer, also what this rule still needs.
        with function.block("if len(trail) > mark:"):
            function.emit(f"yield from bound_again(trail, mark, {answered})")
        with function.block("else:"):
            function.emit(f"yield {answered}")

    given = [(arg, name) for arg, name, known in zip(head.args, parameters, mode, strict=False) if known]
    compiler.asked = True

    def body(inner: Scope) -> None:
        compiler.asked = False
        compiler.formula(rule.body, inner, answer)

    compiler.match_all(given, scope, body)
    function.emit("undo(trail, mark)")
    function.emit("yield from ()")
    unit.add(function)
    return unit
