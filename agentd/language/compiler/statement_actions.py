"""Internal actions that are statements: ``.foreach``, ``.loop``, ``.if_then_else`` and ``.fork``."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator


def as_statement(formula: nodes.BodyFormula) -> nodes.BodyFormula:
    """The statement that a formula stands for; any other formula as it is."""
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
