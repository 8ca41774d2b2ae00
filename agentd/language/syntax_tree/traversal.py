"""Walks syntax without recursion: the parts of compound terms, and the variables that occur in a node."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeGuard

from msgspec.structs import replace

from agentd.language.syntax_tree import nodes
from schemas.files.findings import nearest

HIDDEN = "computed "
"""How the names of variables begin that no program can write."""


def is_plain_variable(node: object) -> TypeGuard[nodes.Variable]:
    """Return whether a node is a variable without decorations."""
    return type(node) is nodes.Variable and node.annotations is None and not node.negated and node.namespace is None


def variables(node: Any) -> dict[str, None]:
    """Return the names of the variables in a node at any depth, in order, without anonymous ones."""
    return {part.name: None for part in walk(node) if type(part) is nodes.Variable and not part.anonymous}


def walk(*trees: Any) -> Iterator[Any]:
    """Yield the nodes of some syntax, or of tuples of it, in order: each before those inside it."""
    pending: list[Any] = [trees]
    while pending:
        node = pending.pop()
        kind = type(node)
        if kind is tuple:
            pending.extend(reversed(node))
            continue
        names = _part_names(kind)
        if names or isinstance(node, nodes.Node):
            yield node
        for name in names:
            part = getattr(node, name)
            if part is not None:
                pending.append(part)


def is_annotated(literal: nodes.Structure | nodes.Variable, word: str) -> bool:
    """Return whether a literal has an annotation of this name: ``word`` or ``word(...)``."""
    items = literal.annotations.items if literal.annotations is not None else ()
    return any(isinstance(item, nodes.Structure) and item.functor == word for item in items)


def is_labelled(plan: nodes.Plan, word: str) -> bool:
    """Return whether a plan's label has an annotation of this name: those of `agentd test` have ``test``."""
    return plan.label is not None and is_annotated(plan.label, word)


LABEL_WORDS = ("all_unifs", "atomic", "test")
"""The annotations of a plan's label that mean something; others are the program's own."""


def misspelt_words(plan: nodes.Plan) -> Iterator[tuple[nodes.Structure, str]]:
    """Yield the annotations of a plan's label that are a word of `LABEL_WORDS` with a letter swapped, lost or doubled.

    A word with another letter, such as ``best``, may be the program's own.
    """
    annotations = None if plan.label is None else plan.label.annotations
    for item in annotations.items if annotations is not None else ():
        if not isinstance(item, nodes.Structure):
            continue
        meant = nearest(item.functor, LABEL_WORDS, 0.75)
        if meant is not None and set(item.functor) <= set(meant):
            yield item, meant


def children(node: Any) -> list[Any]:
    """Return the nodes directly inside a node of any kind, in the order of its fields."""
    found: list[Any] = []
    pending = [getattr(node, name) for name in _part_names(type(node))]
    while pending:
        part = pending.pop()
        if type(part) is tuple:
            pending.extend(reversed(part))
        elif isinstance(part, nodes.Node):
            found.append(part)
    return found


_PARTS: dict[type, tuple[str, ...]] = {}
_NO_PARTS = frozenset(("position", "operator", "functor", "negated"))


def _part_names(kind: type) -> tuple[str, ...]:
    """Return the fields of a class that may hold variables, the last first."""
    names = _PARTS.get(kind)
    if names is None:
        names = _PARTS[kind] = tuple(name for name in reversed(nodes.fields_of(kind)) if name not in _NO_PARTS)
    return names


def parts(node: nodes.Term) -> tuple[nodes.Term, ...] | None:
    """Return the nodes inside a compound term whose terms it is made of; None for all other nodes."""
    match node:
        case nodes.Structure(args=args, annotations=None):
            return args
        case nodes.Structure(args=args, annotations=nodes.ListTerm() as annots):
            return (*args, *annots.items) if annots.tail is None else (*args, *annots.items, annots.tail)
        case nodes.ListTerm(items=items, tail=tail):
            return items if tail is None else (*items, tail)
        case nodes.InternalAction(args=args):
            return args
        case nodes.Arithmetic(operands=operands):
            return operands
        case nodes.And(left, right) | nodes.Or(left, right) | nodes.Relation(_, left, right):
            return left, right
        case nodes.Not(operand=operand):
            return (operand,)
    return None


def with_parts(node: nodes.Term, inner: tuple[Any, ...]) -> nodes.Term:
    """Return the same compound term with other parts, in the order of `parts`."""
    match node:
        case nodes.Structure(args=args, annotations=None):
            return replace(node, args=inner)
        case nodes.Structure(args=args, annotations=nodes.ListTerm(items=items, tail=tail) as annots):
            count, end = len(args), len(args) + len(items)
            annots = replace(annots, items=inner[count:end], tail=None if tail is None else inner[end])
            return replace(node, args=inner[:count], annotations=annots)
        case nodes.ListTerm(items=items, tail=tail):
            return replace(node, items=inner[: len(items)], tail=None if tail is None else inner[-1])
        case nodes.InternalAction():
            return replace(node, args=inner)
        case nodes.Arithmetic():
            return replace(node, operands=inner)
        case nodes.Relation() | nodes.And() | nodes.Or():
            return replace(node, left=inner[0], right=inner[1])
        case nodes.Not():
            return replace(node, operand=inner[0])
    raise TypeError(f"not a compound term: {node!r}")
