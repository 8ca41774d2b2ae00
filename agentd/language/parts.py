"""Compound terms as a node and its parts, so that they can be walked and rebuilt without recursion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from agentd.language import syntax


def parts(node: Any) -> tuple[Any, ...] | None:
    """The nodes inside a compound term whose terms it is made of; None for all other nodes."""
    match node:
        case syntax.Structure(args=args, annotations=None):
            return args
        case syntax.Structure(args=args, annotations=syntax.ListTerm() as annots):
            return (*args, *annots.items) if annots.tail is None else (*args, *annots.items, annots.tail)
        case syntax.ListTerm(items=items, tail=tail):
            return items if tail is None else (*items, tail)
        case syntax.InternalAction(args=args):
            return args
        case syntax.Arithmetic(operands=operands):
            return operands
        case syntax.Relation(left=left, right=right) | syntax.And(left=left, right=right):
            return left, right
        case syntax.Or(left=left, right=right):
            return left, right
        case syntax.Not(operand=operand):
            return (operand,)
    return None


def with_parts(node: Any, inner: tuple[Any, ...]) -> Any:
    """The same compound term with other parts, in the order of `parts`."""
    match node:
        case syntax.Structure(args=args, annotations=None):
            return replace(node, args=inner)
        case syntax.Structure(args=args, annotations=syntax.ListTerm(items=items, tail=tail) as annots):
            count, end = len(args), len(args) + len(items)
            annots = replace(annots, items=inner[count:end], tail=None if tail is None else inner[end])
            return replace(node, args=inner[:count], annotations=annots)
        case syntax.ListTerm(items=items, tail=tail):
            return replace(node, items=inner[: len(items)], tail=None if tail is None else inner[-1])
        case syntax.InternalAction():
            return replace(node, args=inner)
        case syntax.Arithmetic():
            return replace(node, operands=inner)
        case syntax.Relation() | syntax.And() | syntax.Or():
            return replace(node, left=inner[0], right=inner[1])
    return replace(node, operand=inner[0])
