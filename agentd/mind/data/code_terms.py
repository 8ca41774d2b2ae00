"""Plans, triggers, bodies and rules as terms: made and taken apart."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.terms.from_ast import Instantiation, instantiate
from agentd.language.terms.terms import TRUE, Code, Literal, deref
from agentd.mind.data.formula_failure import Failed


def capture(node: Any, values: dict[str, Any]) -> Code:
    """The term for code in braces, with the variables of the plan that it is linked to."""
    return Code(node, {name: deref(v) for name, v in values.items()})


def trigger_literal(code: Code) -> Literal:
    """The literal of a trigger term; its variables are those of the plan that wrote it."""
    literal = instantiate(code.syntax.literal, dict(code.values))
    literal = deref(literal)
    if type(literal) is not Literal:
        raise Failed("body_var_not_literal", "the trigger's literal is a variable without a value")
    return literal


def lone_goal(code: Code) -> Literal | None:
    """The goal of a body of one ``!g``."""
    (formula,) = code.syntax.formulas
    if isinstance(formula, nodes.Step) and formula.operator in (Operator.ACHIEVE, Operator.ACTION):
        term = deref(instantiate(formula.term, dict(code.values)))
        if type(term) is Literal:
            return term
    return None


def parts_of(code: Code) -> list[Any]:
    """Label, trigger, context and body of a plan term, as ``=..`` gives them."""
    node, values = code.syntax, code.values
    if isinstance(node, nodes.Plan):
        made = Instantiation(dict(values), {})
        label = TRUE if node.label is None else made.term(node.label)
        context = TRUE if node.context is None else made.term(node.context)
        return [label, Code(node.trigger, values, bare=True), context, Code(node.body, values, bare=True)]
    return [code]
