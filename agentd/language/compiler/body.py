"""Generates the Python of plan bodies: one function ``run(m, i, f)`` per formula, ``i`` the intention, ``f`` the frame.

A function returns a true value when the intention has to wait, and raises `Failed` when the formula fails. It may set
``f[0]``, the step to come, which is already the next one when it is called: that is how ``if`` and loops jump.
"""

from __future__ import annotations

from typing import Any

from agentd.language.compiler.control_flow import write_brackets, write_for, write_fork, write_if, write_while
from agentd.language.compiler.plan_code import PlanCode, StepCode
from agentd.language.compiler.steps import Bound, StepWriter, write_step
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator


class BodyCompiler:
    """Compiles the formulas of one plan in order, tracking which variables are bound where."""

    def __init__(self, code: PlanCode, library: Any) -> None:
        self.code, self.library = code, library
        self.values: dict[str, Any] = {}
        """Values of variables known when the body became a term; they fill free places before the first step."""

    def body(self, body: nodes.Body, bound: Bound, after: int | None) -> int | None:
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
        for number, formula in zip(numbers, map(_as_statement, body.formulas), strict=True):
            _write(StepWriter(self, number, bound), formula)
        return numbers[0]


def _write(writer: StepWriter, formula: nodes.BodyFormula) -> None:
    match formula:
        case nodes.Step(operator=Operator.ACTION, term=nodes.BodyTerm(body=body)):
            write_brackets(writer, body)
        case nodes.Step():
            write_step(writer, formula)
            writer.finish()
        case nodes.If():
            write_if(writer, formula)
        case nodes.While():
            write_while(writer, formula)
        case nodes.For():
            write_for(writer, formula)
        case nodes.Fork():
            write_fork(writer, formula)


def _without_leading_true(body: nodes.Body) -> nodes.Body:
    """``true`` at the very start of a body or block does nothing (rule 64)."""
    match body.formulas:
        case (nodes.Step(operator=Operator.ACTION, term=nodes.Structure(functor="true", args=())), *_):
            return nodes.Body(body.formulas[1:], body.position)
    return body


def _as_statement(formula: nodes.BodyFormula) -> nodes.BodyFormula:
    """The statement for ``.foreach``, ``.loop``, ``.if_then_else`` or ``.fork``; any other formula as it is."""
    match formula:
        case nodes.Step(operator=Operator.ACTION, term=nodes.InternalAction(name=name, args=args)):
            return _statement(name, args, formula)
    return formula


def _statement(name: str, args: Any, formula: nodes.BodyFormula) -> nodes.BodyFormula:
    place = formula.position
    match name, args:
        case (".foreach", (condition, body)):
            return nodes.For(condition, _as_body(body), place)
        case (".loop", (condition, body)):
            return nodes.While(condition, _as_body(body), place)
        case (".if_then_else", (condition, body)):
            return nodes.If(((condition, _as_body(body)),), None, place)
        case (".if_then_else", (condition, body, otherwise)):
            return nodes.If(((condition, _as_body(body)),), _as_body(otherwise), place)
        case (".fork", (nodes.Structure(functor=kind), *branches)) if branches:
            operator = "|&|" if kind == "and" else "|||"
            return nodes.Fork(operator, tuple(map(_as_body, branches)), place)
    return formula


def _as_body(term: Any) -> nodes.Body:
    """The body that an argument in braces is; a variable is run when it has one."""
    match term:
        case nodes.BodyTerm(body=body):
            return body
        case nodes.TriggerTerm(trigger=trigger):
            return nodes.Body((nodes.Step(Operator(trigger.operator), trigger.literal, term.position),))
    return nodes.Body((nodes.Step(Operator.ACTION, term, term.position),))
