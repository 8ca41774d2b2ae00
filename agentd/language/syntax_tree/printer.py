"""Syntax trees to AgentSpeak text that reads back as the same tree.

Written as Jason writes terms (expressions in brackets, lists without blanks), except that strings are escaped. What
``.print`` shows of run-time terms is in `term_text`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final, TypeAlias, get_args

from agentd.language.syntax_tree import nodes

Node: TypeAlias = nodes.Program | nodes.Item | nodes.Trigger | nodes.Body | nodes.BodyFormula | nodes.Term
_Pieces: TypeAlias = list[str | Node]
_TERMS: Final = get_args(nodes.Term)


def source_text(node: Node) -> str:
    """Return the text of a program, or of an item, trigger, body, formula or term, at any depth: no recursion."""
    return _text([node], None)


def unbraced_text(
    node: nodes.Plan | nodes.Trigger | nodes.Rule | nodes.Body, term_text: Callable[[nodes.Term], str]
) -> str:
    """Return the text of what braces may hold, without them, each term in it as ``term_text`` writes it."""
    match node:
        case nodes.Body():
            return _text([node], term_text)
        case nodes.Plan(subplans=subplans) if subplans:
            inner = _separated([[plan] for plan in subplans], " ")
            return _text([*_unfinished(node), " { ", *inner, " }"], term_text)
    return _text(_unfinished(node), term_text)


def _text(pending: _Pieces, term_text: Callable[[nodes.Term], str] | None) -> str:
    out: list[str] = []
    pending.reverse()
    while pending:
        piece = pending.pop()
        if isinstance(piece, str):
            out.append(piece)
        elif term_text is not None and isinstance(piece, _TERMS):
            out.append(term_text(piece))
        else:
            pending.extend(reversed(_pieces(piece)))
    return "".join(out)


def _pieces(node: Node) -> _Pieces:
    """Return what a node consists of, in order: text and the nodes inside it."""
    match node:
        case nodes.Number(value):
            return [_number(value)]
        case nodes.String(value):
            return ['"', value.replace('"', '\\"').replace("\n", "\\n"), '"']
        case nodes.Variable() | nodes.Structure():
            return _literal(node)
        case nodes.InternalAction(name, args):
            return [name, *_arguments(args)]
        case nodes.ListTerm(items, tail):
            return [
                "[",
                *_separated([_operand(item) for item in items]),
                *(["|", tail] if tail is not None else []),
                "]",
            ]
        case nodes.Arithmetic(operator, operands):
            left = operands[:-1]
            return ["(", *left, f" {operator} " if operator.isalpha() else operator, operands[-1], ")"]
        case nodes.Relation(operator, left, right):
            return ["(", *_operand(left), f" {operator} ", *_operand(right), ")"]
        case nodes.And(left, right):
            return ["(", left, " & ", right, ")"]
        case nodes.Or(left, right):
            return ["(", left, " | ", right, ")"]
        case nodes.Not(operand):
            return ["not (", operand, ")"]
        case (
            nodes.PlanTerm(nodes.Plan() as inner)
            | nodes.TriggerTerm(nodes.Trigger() as inner)
            | nodes.RuleTerm(nodes.Rule() as inner)
        ):
            return ["{ ", *_unfinished(inner), " }"]
        case nodes.BodyTerm(body):
            return _block(body)
        case nodes.Step() | nodes.If() | nodes.While() | nodes.For() | nodes.Fork():
            return _formula(node)
        case nodes.Body(formulas):
            return _separated([[formula] for formula in formulas], "; ")
        case nodes.Trigger():
            return _unfinished(node)
        case _:
            return _item(node)


def _item(node: nodes.Program | nodes.Item) -> _Pieces:
    match node:
        case nodes.Program(items=items):
            return _separated([[item] for item in items], "\n")
        case nodes.Belief(literal):
            return [literal, "."]
        case nodes.Goal(literal, operator):
            return [operator, literal, "."]
        case nodes.Directive(name, None):
            return ["{ ", name, " }"]
        case nodes.Directive(name, items):
            return ["{ begin ", name, " }\n", *_each(items or (), "\n"), "{ end }"]
        case nodes.Plan(subplans=()) | nodes.Rule():
            return [*_unfinished(node), "."]
        case nodes.Plan(subplans=subplans):
            return [*_unfinished(node), ". {\n", *_each(subplans, "\n"), "}"]
    raise TypeError(f"no syntax: {node!r}")


def _unfinished(node: nodes.Plan | nodes.Trigger | nodes.Rule) -> _Pieces:
    """Return a plan, trigger or rule without its dot."""
    match node:
        case nodes.Trigger(operator, goal, literal):
            return [operator, goal, literal]
        case nodes.Rule(head, body):
            return [head, " :- ", body]
    pieces: _Pieces = []
    if node.label is not None:
        pieces += ["@", node.label, " "]
    pieces.append(node.trigger)
    if node.context is not None:
        pieces += [" : ", node.context]
    if node.goal_condition is not None:
        pieces += [" <: ", node.goal_condition]
    if node.body.formulas:
        pieces += [" <- ", node.body]
    return pieces


def _formula(node: nodes.BodyFormula) -> _Pieces:
    match node:
        case nodes.Step(operator, term):
            return [operator.value, term]
        case nodes.If(branches, otherwise):
            pieces: _Pieces = []
            for i, (condition, body) in enumerate(branches):
                pieces += [" elif (" if i else "if (", condition, ") ", *_block(body)]
            return pieces if otherwise is None else [*pieces, " else ", *_block(otherwise)]
        case nodes.While(condition, body):
            return ["while (", condition, ") ", *_block(body)]
        case nodes.For(condition, body):
            return ["for (", condition, ") ", *_block(body)]
        case nodes.Fork(operator, bodies):
            return _separated([_branch(body) for body in bodies], f" {operator} ")


def _branch(body: nodes.Body) -> _Pieces:
    match body.formulas:
        case (nodes.Step(operator, term) as step,) if operator is not nodes.Operator.ACTION or not isinstance(
            term, nodes.BodyTerm
        ):
            return [step]
    return _block(body)


def _block(body: nodes.Body) -> _Pieces:
    return ["{ ", body, " }"] if body.formulas else ["{ }"]


def _literal(node: nodes.Structure | nodes.Variable) -> _Pieces:
    pieces: _Pieces = ["~"] if node.negated else []
    if node.namespace is not None:
        pieces += [node.namespace, "::"]
    if isinstance(node, nodes.Variable):
        pieces.append(node.name)
    else:
        pieces += [node.functor, *_arguments(node.args)]
    if node.annotations is not None:
        pieces.append(node.annotations)
    return pieces


def _arguments(args: tuple[nodes.Term, ...]) -> _Pieces:
    return ["(", *_separated([[arg] for arg in args]), ")"] if args else []


def _operand(term: nodes.Term) -> _Pieces:
    """Return a term where a logical formula needs brackets; all but ``not`` have theirs."""
    return ["(", term, ")"] if isinstance(term, nodes.Not) else [term]


def _separated(parts: Iterable[_Pieces], separator: str = ",") -> _Pieces:
    pieces: _Pieces = []
    for part in parts:
        if pieces:
            pieces.append(separator)
        pieces += part
    return pieces


def _each(items: Iterable[nodes.Item], end: str) -> _Pieces:
    pieces: _Pieces = []
    for item in items:
        pieces += [item, end]
    return pieces


def _number(value: float) -> str:
    if value == float("inf"):
        return "1e999"
    return str(int(value)) if value < 1e15 and value == int(value) else repr(value)
