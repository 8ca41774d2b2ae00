"""Syntax trees to AgentSpeak text that reads back as the same tree.

Written as Jason writes terms (expressions in brackets, lists without blanks), except that strings are escaped. What
``.print`` shows of run-time terms is in `term_text`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from agentd.language.syntax_tree.nodes import (
    And,
    Arithmetic,
    Belief,
    Body,
    BodyFormula,
    BodyTerm,
    Directive,
    For,
    Fork,
    Goal,
    If,
    InternalAction,
    Item,
    ListTerm,
    Not,
    Number,
    Operator,
    Or,
    Plan,
    PlanTerm,
    Program,
    Relation,
    Rule,
    RuleTerm,
    Step,
    String,
    Structure,
    Term,
    Trigger,
    TriggerTerm,
    Variable,
    While,
)

Node: TypeAlias = Program | Item | Trigger | Body | BodyFormula | Term
_Pieces: TypeAlias = list[str | Node]


def source_text(node: Node) -> str:
    """The text of a program, an item, a trigger, a body or a formula of it, or a term. Any depth: no recursion."""
    out: list[str] = []
    pending: _Pieces = [node]
    while pending:
        piece = pending.pop()
        if isinstance(piece, str):
            out.append(piece)
        else:
            pending.extend(reversed(_pieces(piece)))
    return "".join(out)


def _pieces(node: Node) -> _Pieces:
    """What a node consists of, in order: text and the nodes inside it."""
    match node:
        case Number(value):
            return [_number(value)]
        case String(value):
            return ['"', value.replace('"', '\\"').replace("\n", "\\n"), '"']
        case Variable() | Structure():
            return _literal(node)
        case InternalAction(name, args):
            return [name, *_arguments(args)]
        case ListTerm(items, tail):
            return [
                "[",
                *_separated([_operand(item) for item in items]),
                *(["|", tail] if tail is not None else []),
                "]",
            ]
        case Arithmetic(operator, operands):
            left = operands[:-1]
            return ["(", *left, f" {operator} " if operator.isalpha() else operator, operands[-1], ")"]
        case Relation(operator, left, right):
            return ["(", *_operand(left), f" {operator} ", *_operand(right), ")"]
        case And(left, right):
            return ["(", left, " & ", right, ")"]
        case Or(left, right):
            return ["(", left, " | ", right, ")"]
        case Not(operand):
            return ["not (", operand, ")"]
        case PlanTerm(Plan() as inner) | TriggerTerm(Trigger() as inner) | RuleTerm(Rule() as inner):
            return ["{ ", *_unfinished(inner), " }"]
        case BodyTerm(body):
            return _block(body)
        case Step() | If() | While() | For() | Fork():
            return _formula(node)
        case Body(formulas):
            return _separated([[formula] for formula in formulas], "; ")
        case Trigger():
            return _unfinished(node)
        case _:
            return _item(node)


def _item(node: Program | Item) -> _Pieces:
    match node:
        case Program(items=items):
            return _separated([[item] for item in items], "\n")
        case Belief(literal):
            return [literal, "."]
        case Goal(literal, operator):
            return [operator, literal, "."]
        case Directive(name, None):
            return ["{ ", name, " }"]
        case Directive(name, items):
            return ["{ begin ", name, " }\n", *_each(items or (), "\n"), "{ end }"]
        case Plan(subplans=()) | Rule():
            return [*_unfinished(node), "."]
        case Plan(subplans=subplans):
            return [*_unfinished(node), ". {\n", *_each(subplans, "\n"), "}"]
    raise TypeError(f"no syntax: {node!r}")


def _unfinished(node: Plan | Trigger | Rule) -> _Pieces:
    """A plan, trigger or rule without its dot."""
    match node:
        case Trigger(operator, goal, literal):
            return [operator, goal, literal]
        case Rule(head, body):
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


def _formula(node: BodyFormula) -> _Pieces:
    match node:
        case Step(operator, term):
            return [operator.value, term]
        case If(branches, otherwise):
            pieces: _Pieces = []
            for i, (condition, body) in enumerate(branches):
                pieces += [" elif (" if i else "if (", condition, ") ", *_block(body)]
            return pieces if otherwise is None else [*pieces, " else ", *_block(otherwise)]
        case While(condition, body):
            return ["while (", condition, ") ", *_block(body)]
        case For(condition, body):
            return ["for (", condition, ") ", *_block(body)]
        case Fork(operator, bodies):
            return _separated([_branch(body) for body in bodies], f" {operator} ")


def _branch(body: Body) -> _Pieces:
    match body.formulas:
        case (Step(operator, term) as step,) if operator is not Operator.ACTION or not isinstance(term, BodyTerm):
            return [step]
    return _block(body)


def _block(body: Body) -> _Pieces:
    return ["{ ", body, " }"] if body.formulas else ["{ }"]


def _literal(node: Structure | Variable) -> _Pieces:
    pieces: _Pieces = ["~"] if node.negated else []
    if node.namespace is not None:
        pieces += [node.namespace, "::"]
    if isinstance(node, Variable):
        pieces.append(node.name)
    else:
        pieces += [node.functor, *_arguments(node.args)]
    if node.annotations is not None:
        pieces.append(node.annotations)
    return pieces


def _arguments(args: tuple[Term, ...]) -> _Pieces:
    return ["(", *_separated([[arg] for arg in args]), ")"] if args else []


def _operand(term: Term) -> _Pieces:
    """A term where a logical formula needs brackets; all but ``not`` have theirs."""
    return ["(", term, ")"] if isinstance(term, Not) else [term]


def _separated(parts: Iterable[_Pieces], separator: str = ",") -> _Pieces:
    pieces: _Pieces = []
    for part in parts:
        if pieces:
            pieces.append(separator)
        pieces += part
    return pieces


def _each(items: Iterable[Item], end: str) -> _Pieces:
    pieces: _Pieces = []
    for item in items:
        pieces += [item, end]
    return pieces


def _number(value: float) -> str:
    if value == float("inf"):
        return "1e999"
    return str(int(value)) if value < 1e15 and value == int(value) else repr(value)
