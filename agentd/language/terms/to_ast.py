"""Run-time terms back into syntax, for what is sent or saved as source text."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any, Final

from msgspec.structs import replace

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.terms.terms import (
    ARITHMETIC,
    MOST_NODES,
    PER_PART,
    Code,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Var,
    deref,
    split,
)


class NoSyntax(ValueError):
    """A term that cannot be written as source text; the message gives the reason."""


class VariableNames:
    """Names for variables: as they are called, but different for different ones."""

    def __init__(self) -> None:
        self._names: dict[Var, str] = {}
        self._taken: dict[str, None] = {}

    def of(self, variable: Var) -> str:
        """Return the name of a free variable; one that begins with ``_`` stays anonymous."""
        known = self._names.get(variable)
        if known is not None:
            return known
        name = wanted = variable.name if variable.name[:1].isupper() or variable.name[:1] == "_" else "_"
        number = 0
        while name in self._taken and not name.startswith("_"):
            number += 1
            name = f"{wanted}_{number}"
        self._taken[name] = None
        self._names[variable] = name
        return name


class ToSyntax:
    """Makes the syntax of terms that share their variables, none nested deeper than ``deepest``.

    Its methods raise NoSyntax for what is nested deeper, too large, or has no syntax, such as a map.
    """

    def __init__(self, deepest: int) -> None:
        self._deepest, self._left = deepest, MOST_NODES
        self.names = VariableNames()

    def term(self, term: Any, depth: int = 0) -> Any:
        """Return the syntax of a term that is nested ``depth`` deep in others."""
        if depth > self._deepest:
            raise NoSyntax(f"nested deeper than {self._deepest}")
        self.count()
        term = deref(term)
        match term:
            case float():
                return _number(term)
            case str():
                self.count(len(term) // PER_PART)
                return _string(term)
            case Var():
                return nodes.Variable(self.names.of(term))
            case Literal():
                return self._structure(term, depth)
            case List():
                items, tail = split(term)
                end = None if type(tail) is List else self.term(tail, depth + 1)
                return nodes.ListTerm(self._several(items, depth), end)
            case Open():
                return self._open(term, depth)
            case Expression(operator=operator):
                return _operation(operator, self._several(term.operands, depth))
            case Code():
                node = self.code(term.syntax, term.values)
                kinds: dict[type, Callable[[Any], nodes.Term]] = {
                    nodes.Plan: nodes.PlanTerm,
                    nodes.Trigger: nodes.TriggerTerm,
                    nodes.Rule: nodes.RuleTerm,
                    nodes.Body: nodes.BodyTerm,
                }
                return kinds[type(node)](node)
        raise NoSyntax(f"a {type(term).__name__.lower()} cannot be written as text")

    def count(self, parts: int = 1) -> None:
        """Count parts of a term, which may be in it many times. Raises NoSyntax if there are too many."""
        self._left -= parts
        if self._left < 0:
            raise NoSyntax(f"more than {MOST_NODES} parts")

    def code(self, node: Any, values: dict[str, Any]) -> Any:
        """Return a syntax tree with the variables that have values replaced by these."""
        if not values:
            return node
        if isinstance(node, nodes.Variable):
            if node.name not in values or node.annotations is not None:
                return node
            return self.term(values[node.name])
        if isinstance(node, tuple):
            return tuple(self.code(item, values) for item in node)
        if isinstance(node, nodes.Node):
            changed = {name: self.code(getattr(node, name), values) for name in node.__struct_fields__}
            return replace(node, **changed)
        return node

    def _several(self, terms: Iterable[Any], depth: int) -> tuple[nodes.Term, ...]:
        return tuple(self.term(term, depth + 1) for term in terms)

    def _structure(self, term: Literal, depth: int) -> nodes.Structure:
        sig = term.sig
        if not _NAME.fullmatch(sig.functor) or (sig.functor in _RESERVED and (term.args or sig.functor not in _TRUTH)):
            raise NoSyntax(f"the name '{sig.functor}' cannot be written")
        annots = self._annotations(term.annots, depth)
        namespace = None if sig.namespace == DEFAULT else sig.namespace
        return nodes.Structure(sig.functor, self._several(term.args, depth), annots, sig.negated, namespace)

    def _annotations(self, annots: tuple[Any, ...] | None, depth: int) -> nodes.ListTerm | None:
        if not annots:
            return None
        last = annots[-1]
        if type(last) is Rest:
            return nodes.ListTerm(self._several(annots[:-1], depth), self.term(last.tail, depth + 1))
        return nodes.ListTerm(self._several(annots, depth))

    def _open(self, term: Open, depth: int) -> nodes.Variable | nodes.Structure:
        """Return a decorated variable, or a literal in a namespace that is a variable."""
        namespace = deref(term.namespace)
        if namespace is not None and not isinstance(namespace, str):
            namespace = self.term(namespace, depth + 1)
        if term.literal is not None:
            return replace(self._structure(term.literal, depth), namespace=namespace)
        variable = deref(term.variable)
        if type(variable) is not Var:
            raise NoSyntax("a decorated variable that has a value cannot be written as text")
        annots = self._annotations(term.annots, depth)
        return nodes.Variable(self.names.of(variable), annots, term.negated, namespace)


_NAME: Final = re.compile(r"'[^'\n]*'|\.?[a-z]\w*(\.[a-zA-Z_]\w*)*", re.ASCII)
_TRUTH: Final = ("true", "false")
_RESERVED: Final = ("if", "elif", "else", "while", "for", "div", "mod", "not", *_TRUTH)
_READABLE: Final = re.compile(r"(?:[^\\]|\\[tbrf0-7'\\])*", re.DOTALL)
"""Text whose backslashes come in the pairs that a string literal may hold and that reading leaves as they are."""


def _string(value: str) -> nodes.String:
    if "\\" in value and not _READABLE.fullmatch(value):
        raise NoSyntax("a string with such a backslash cannot be written")
    return nodes.String(value)


def _number(value: float) -> nodes.Number | nodes.Arithmetic:
    """Return a number as syntax: a numeral is never negative, and there is none for NaN."""
    if value != value:
        return nodes.Arithmetic("/", (nodes.Number(0.0), nodes.Number(0.0)))
    if value < 0:
        return nodes.Arithmetic("-", (nodes.Number(-value),))
    return nodes.Number(value)


def _operation(operator: str, operands: tuple[Any, ...]) -> nodes.Term:
    for kind, written in nodes.CONNECTIVES.items():
        if written == operator:
            return kind(*operands)  # type: ignore[no-any-return]
    return nodes.Arithmetic(operator, operands) if operator in ARITHMETIC else nodes.Relation(operator, *operands)
