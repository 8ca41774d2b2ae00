"""Generates the Python of plan bodies: one function ``run(m, i, f)`` per formula, ``i`` the intention, ``f`` the frame.

A function returns a true value when the intention has to wait, and raises `Failed` when the formula fails. It may set
``f[0]``, the step to come, which is already the next one when it is called: that is how ``if`` and loops jump.
"""

from __future__ import annotations

from typing import Any

from agentd.language import syntax
from agentd.language.compile_control import write_brackets, write_for, write_fork, write_if, write_while
from agentd.language.plan_code import PlanCode, StepCode
from agentd.language.statements import as_statement
from agentd.language.steps import Bound, StepWriter, write_step


class BodyCompiler:
    """Compiles the formulas of one plan in order, tracking which variables are bound where."""

    def __init__(self, code: PlanCode, library: Any) -> None:
        self.code, self.library = code, library
        self.values: dict[str, Any] = {}
        """Values of variables known when the body became a term; they fill free places before the first step."""

    def body(self, body: syntax.Body, bound: Bound, after: int | None) -> int | None:
        """Compile a body; ``bound`` is updated to what holds at its end. Returns its first step, ``after`` if empty."""
        body = _without_leading_true(body)
        if not body.formulas:
            return after
        numbers = []
        for formula in body.formulas:
            numbers.append(len(self.code.steps))
            self.code.steps.append(StepCode("", formula))
        for number, following in zip(numbers, [*numbers[1:], after], strict=False):  # an empty body has no step
            self.code.steps[number].next = following
        for number, formula in zip(numbers, map(as_statement, body.formulas), strict=True):
            _write(StepWriter(self, number, bound), formula)
        return numbers[0]


def _write(writer: StepWriter, formula: syntax.BodyFormula) -> None:
    match formula:
        case syntax.Step(operator=syntax.Operator.ACTION, term=syntax.BodyTerm(body=body)):
            write_brackets(writer, body)
        case syntax.Step():
            write_step(writer, formula)
            writer.finish()
        case syntax.If():
            write_if(writer, formula)
        case syntax.While():
            write_while(writer, formula)
        case syntax.For():
            write_for(writer, formula)
        case syntax.Fork():
            write_fork(writer, formula)


def _without_leading_true(body: syntax.Body) -> syntax.Body:
    """``true`` at the very start of a body or block does nothing (rule 64)."""
    match body.formulas:
        case (syntax.Step(operator=syntax.Operator.ACTION, term=syntax.Structure(functor="true", args=())), *_):
            return syntax.Body(body.formulas[1:], body.position)
    return body
