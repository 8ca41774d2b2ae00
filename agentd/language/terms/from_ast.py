"""From syntax to run-time terms, for facts, messages and error texts; never on a plan's hot path."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT, signature
from agentd.language.syntax_tree.traversal import parts
from agentd.language.terms.numbers import OPERATIONS, UndefinedNumber
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.terms import (
    ARITHMETIC,
    Code,
    Expression,
    Literal,
    Open,
    Rest,
    Var,
    deref,
    elements,
    make_list,
)

Functions = Mapping[tuple[str, int], Callable[..., Any]]
"""Functions by name and arity, as ``math.max`` with 2; each takes terms and returns one, or None for no value."""


def instantiate(node: nodes.Term, values: dict[str, Any] | None = None) -> Any:
    """Return the run-time term of a syntax node; arithmetic over numbers is computed.

    ``values`` gives variables their terms; a named variable without one is added to it as a free `Var`.
    """
    return Instantiation({} if values is None else values, {}).term(node)


class Instantiation:
    """Builds the terms of several nodes that share their variables; calls of ``functions`` are computed."""

    def __init__(self, values: dict[str, Any], functions: Functions) -> None:
        self.values, self._functions = values, functions

    def term(self, node: nodes.Term) -> Any:
        """Return the term of a node, at any depth: parts are made before what they are parts of, without recursion."""
        work: list[tuple[Any, int]] = [(node, -1)]
        done: list[Any] = []
        while work:
            node, count = work.pop()
            if isinstance(node, nodes.Number | nodes.String):
                done.append(node.value)
            elif count >= 0:
                made = tuple(done[len(done) - count :])
                del done[len(done) - count :]
                done.append(self._made(node, made))
            elif (inner := parts(node)) is None:
                done.append(self._leaf(node))
            else:
                work.append((node, len(inner)))
                work.extend([(part, -1) for part in reversed(inner)])
        return done[0]

    def _leaf(self, node: Any) -> Any:
        match node:
            case nodes.Variable():
                return self._variable(node)
            case nodes.PlanTerm(inner) | nodes.TriggerTerm(inner) | nodes.BodyTerm(inner) | nodes.RuleTerm(inner):
                known = {name: deref(v) for name, v in self.values.items()}
                return Code(inner, {name: value for name, value in known.items() if type(value) is not Var})
        raise TypeError(f"not a term: {node!r}")

    def _made(self, node: Any, made: tuple[Any, ...]) -> Any:
        """Return a term of the terms of its parts."""
        match node:
            case nodes.Structure(args=args, annotations=annots):
                count = len(args)
                tail = None if annots is None or annots.tail is None else made[-1]
                found = made[count : len(made) - (tail is not None)]
                return self._structure(node, made[:count], _with_tail(found, tail) if annots is not None else ())
            case nodes.ListTerm(tail=None):
                return make_list(made)
            case nodes.ListTerm():
                return make_list(made[:-1], made[-1])
            case nodes.InternalAction(name=name):
                value = self._value(name, made)
                return Literal(signature(name, len(made)), made) if value is None else value
            case nodes.Arithmetic(operator=operator):
                try:
                    return calculate(operator, made)
                except UndefinedNumber:
                    return Expression(operator, made)
            case nodes.Relation(operator=operator):
                return Expression(operator, made)
        return Expression(nodes.CONNECTIVES[type(node)], made)

    def annots(self, node: nodes.ListTerm | None) -> tuple[Any, ...]:
        """Return the annotations of a list of syntax: a bound tail adds its own, a free one takes the rest."""
        if node is None:
            return ()
        tail = None if node.tail is None else self.term(node.tail)
        return _with_tail([self.term(item) for item in node.items], tail)

    def _variable(self, node: nodes.Variable) -> Any:
        if node.anonymous:
            variable: Any = Var(node.name)
        else:
            variable = self.values.get(node.name)
            if variable is None:
                variable = self.values[node.name] = Var(node.name)
            variable = deref(variable)
        if node.annotations is None and not node.negated and node.namespace is None:
            return variable
        annots = None if node.annotations is None else self.annots(node.annotations)
        return Open(variable, annots, node.negated, self._namespace(node.namespace))

    def _namespace(self, namespace: str | nodes.Variable | None) -> Any:
        if isinstance(namespace, nodes.Variable):
            return self._variable(namespace)
        return namespace

    def _structure(self, node: nodes.Structure, args: tuple[Any, ...], annots: tuple[Any, ...]) -> Any:
        value = self._value(node.functor, args)
        if value is not None:
            return value
        namespace = self._namespace(node.namespace)
        if namespace is None or isinstance(namespace, str):
            return Literal(signature(node.functor, len(args), node.negated, namespace or DEFAULT), args, annots)
        bound = deref(namespace)
        if type(bound) is Literal:
            return Literal(signature(node.functor, len(args), node.negated, bound.sig.functor), args, annots)
        literal = Literal(signature(node.functor, len(args), node.negated), args, annots)
        return Open(Var(), None, False, namespace, literal)

    def _value(self, name: str, args: tuple[Any, ...]) -> Any:
        """Return what the function of this name computes, None if there is none or it has no value."""
        function = self._functions.get((name, len(args)))
        return None if function is None else function(*args)


def _with_tail(annots: Sequence[Any], tail: Any) -> tuple[Any, ...]:
    if tail is None:
        return sorted_annots(annots)
    if type(tail) is Var:
        return (*sorted_annots(annots), Rest(tail))
    return sorted_annots((*annots, *elements(tail)))


def calculate(operator: str, operands: tuple[Any, ...]) -> Any:
    """Return the value of an operation on numbers; an expression if an operand is free; NaN for other operands.

    Raises `UndefinedNumber` for ``div`` by zero.
    """
    values = []
    for operand in operands:
        found = number(operand)
        if type(found) is Var:
            return Expression(operator, operands, found)
        values.append(found)
    if len(values) == 1:
        return -values[0] if operator == "-" else values[0]
    return OPERATIONS[operator](values[0], values[1])


def number(term: Any) -> Any:
    """Return the number of a term in arithmetic: NaN if it has none and never will; while it is open, a variable.

    The variable is one that has to get a value first.
    """
    term = deref(term)
    if type(term) is float or type(term) is Var:
        return term
    if type(term) is not Expression or term.operator not in ARITHMETIC:
        return math.nan
    if term.waits_for is None or term.waits_for.ref is not None:
        found = _computed(term)
        if type(found) is not Var:
            return found
        term.waits_for = found
    return term.waits_for


def _computed(expression: Expression) -> float | Var:
    """Return the value of arithmetic nested to any depth; a free variable as soon as one is met.

    An expression that is in it many times is computed once.
    """
    work: list[tuple[Any, bool]] = [(expression, False)]
    values: list[float] = []
    computed: dict[int, float] = {}
    while work:
        term, ready = work.pop()
        if ready:
            right = values.pop()
            if len(term.operands) == 1:
                values.append(-right if term.operator == "-" else right)
            else:
                values.append(OPERATIONS[term.operator](values.pop(), right))
            computed[id(term)] = values[-1]
            continue
        term = deref(term)
        if (known := computed.get(id(term))) is not None:
            values.append(known)
            continue
        if type(term) is float:
            values.append(term)
        elif type(term) is Var:
            return term
        elif type(term) is Expression and term.operator in ARITHMETIC:
            work.append((term, True))
            work.extend((operand, False) for operand in reversed(term.operands))
        else:
            values.append(math.nan)
    return values[0]
