"""From syntax to run-time terms, for facts, messages and error texts; never on a plan's hot path."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from agentd.language import syntax
from agentd.language.numbers import OPERATIONS, UndefinedNumber
from agentd.language.order import sorted_annots
from agentd.language.signatures import DEFAULT, signature
from agentd.language.terms import EMPTY, Code, Expression, Literal, Open, Rest, Var, deref, elements, make_list

Functions = Mapping[tuple[str, int], Callable[..., Any]]
"""Functions by name and arity, as ``math.max`` with 2; each takes terms and returns one, or None for no value."""


def instantiate(node: syntax.Term, values: dict[str, Any] | None = None, functions: Functions | None = None) -> Any:
    """The run-time term that a syntax node stands for.

    ``values`` gives variables their terms; a named variable without one is added to it as a free `Var`. Arithmetic
    over numbers is computed, and so are calls of ``functions``.
    """
    return Instantiation({} if values is None else values, functions or {}).term(node)


class Instantiation:
    """Builds the terms of several nodes that share their variables."""

    def __init__(self, values: dict[str, Any], functions: Functions) -> None:
        self.values, self._functions = values, functions

    def term(self, node: syntax.Term) -> Any:
        match node:
            case syntax.Number(value=value) | syntax.String(value=value):
                return value
            case syntax.Variable():
                return self._variable(node)
            case syntax.Structure():
                return self._structure(node)
            case syntax.ListTerm():
                return self._list(node)
            case syntax.InternalAction(name=name, args=args):
                return self._call(name, tuple(self.term(a) for a in args))
            case syntax.Arithmetic(operator=operator, operands=operands):
                built = tuple(self.term(o) for o in operands)
                try:
                    return calculate(operator, built)
                except UndefinedNumber:
                    return Expression(operator, built)
            case syntax.Relation(operator=operator, left=left, right=right):
                return Expression(operator, (self.term(left), self.term(right)))
            case syntax.And(left=left, right=right):
                return Expression("&", (self.term(left), self.term(right)))
            case syntax.Or(left=left, right=right):
                return Expression("|", (self.term(left), self.term(right)))
            case syntax.Not(operand=operand):
                return Expression("not", (self.term(operand),))
            case syntax.PlanTerm(plan=inner) | syntax.TriggerTerm(trigger=inner):
                return Code(inner, self._bound())
            case syntax.BodyTerm(body=inner) | syntax.RuleTerm(rule=inner):
                return Code(inner, self._bound())
        raise TypeError(f"not a term: {node!r}")

    def annots(self, node: syntax.ListTerm | None) -> tuple[Any, ...]:
        """The annotations that a list of syntax stands for: a bound tail adds its own, a free one takes the rest."""
        if node is None:
            return ()
        found, end = [self.term(item) for item in node.items], node.tail
        if end is None:
            return sorted_annots(found)
        tail = self.term(end)
        if type(tail) is Var:
            return (*sorted_annots(found), Rest(tail))
        return sorted_annots((*found, *elements(tail)))

    def _variable(self, node: syntax.Variable) -> Any:
        if node.anonymous:
            variable: Any = Var(node.name)
        else:
            variable = self.values.get(node.name)
            if variable is None:
                variable = self.values[node.name] = Var(node.name)
            variable = deref(variable)
        if node.annotations is None and not node.negated and node.namespace is None:
            return variable
        return Open(variable, self._open_annots(node.annotations), node.negated, self._namespace(node.namespace))

    def _open_annots(self, node: syntax.ListTerm | None) -> tuple[Any, ...] | None:
        return None if node is None else self.annots(node)

    def _namespace(self, namespace: str | syntax.Variable | None) -> Any:
        if isinstance(namespace, syntax.Variable):
            return self._variable(namespace)
        return namespace

    def _structure(self, node: syntax.Structure) -> Any:
        args = tuple(self.term(a) for a in node.args)
        function = self._functions.get((node.functor, len(args)))
        if function is not None:
            value = function(*args)
            if value is not None:
                return value
        namespace = self._namespace(node.namespace)
        annots = self.annots(node.annotations)
        if namespace is None or isinstance(namespace, str):
            return Literal(signature(node.functor, len(args), node.negated, namespace or DEFAULT), args, annots)
        bound = deref(namespace)
        if type(bound) is Literal:
            return Literal(signature(node.functor, len(args), node.negated, bound.sig.functor), args, annots)
        literal = Literal(signature(node.functor, len(args), node.negated), args, annots)
        return Open(Var(), None, False, namespace, literal)

    def _list(self, node: syntax.ListTerm) -> Any:
        tail = EMPTY if node.tail is None else self.term(node.tail)
        return make_list((self.term(item) for item in node.items), tail)

    def _call(self, name: str, args: tuple[Any, ...]) -> Any:
        function = self._functions.get((name, len(args)))
        if function is not None:
            value = function(*args)
            if value is not None:
                return value
        return Literal(signature(name, len(args)), args)

    def _bound(self) -> dict[str, Any]:
        return {name: deref(v) for name, v in self.values.items() if type(deref(v)) is not Var}


def calculate(operator: str, operands: tuple[Any, ...]) -> Any:
    """The value of an operation on numbers; the symbolic expression if an operand is free; NaN for other operands.

    Raises `UndefinedNumber` for ``div`` by zero.
    """
    values = [number(o) for o in operands]
    if any(v is None for v in values):
        return Expression(operator, operands)
    if len(values) == 1:
        return -values[0] if operator == "-" else values[0]
    return OPERATIONS[operator](values[0], values[1])


def number(term: Any) -> Any:
    """The number that a term is worth in arithmetic: NaN if it has none and never will, None while it is open."""
    term = deref(term)
    if type(term) is float:
        return term
    if type(term) is Var:
        return None
    if type(term) is Expression and (len(term.operands) == 1 or term.operator in OPERATIONS) and term.operator != "not":
        value = calculate(term.operator, term.operands)
        return value if type(value) is float else None
    return float("nan")
