"""Internal actions that are statements: ``.foreach``, ``.loop``, ``.if_then_else`` and ``.fork``."""

from __future__ import annotations

from typing import Any

from agentd.language import syntax
from agentd.language.syntax import Operator


def as_statement(formula: syntax.BodyFormula) -> syntax.BodyFormula:
    """The statement that a formula stands for; any other formula as it is."""
    match formula:
        case syntax.Step(operator=Operator.ACTION, term=syntax.InternalAction(name=name, args=args)):
            return _statement(name, args, formula)
    return formula


def _statement(name: str, args: Any, formula: syntax.BodyFormula) -> syntax.BodyFormula:
    place = formula.position
    match name, args:
        case (".foreach", (condition, body)):
            return syntax.For(condition, _as_body(body), place)
        case (".loop", (condition, body)):
            return syntax.While(condition, _as_body(body), place)
        case (".if_then_else", (condition, body)):
            return syntax.If(((condition, _as_body(body)),), None, place)
        case (".if_then_else", (condition, body, otherwise)):
            return syntax.If(((condition, _as_body(body)),), _as_body(otherwise), place)
        case (".fork", (syntax.Structure(functor=kind), *branches)) if branches:
            operator = "|&|" if kind == "and" else "|||"
            return syntax.Fork(operator, tuple(map(_as_body, branches)), place)
    return formula


def _as_body(term: Any) -> syntax.Body:
    """The body that an argument in braces is; a variable is run when it has one."""
    match term:
        case syntax.BodyTerm(body=body):
            return body
        case syntax.TriggerTerm(trigger=trigger):
            return syntax.Body((syntax.Step(Operator(trigger.operator), trigger.literal, term.position),))
    return syntax.Body((syntax.Step(Operator.ACTION, term, term.position),))
