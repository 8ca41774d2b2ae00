"""What of a program is known before it runs: signatures, and ground terms, which are made once."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from agentd.language import syntax
from agentd.language.instantiate import instantiate
from agentd.language.order import sorted_annots
from agentd.language.signatures import DEFAULT, Signature, signature
from agentd.language.sources import is_source, told_by
from agentd.language.terms import List, Literal, atom


def signature_of(node: syntax.Structure) -> Signature:
    """The signature of a literal whose namespace is known."""
    namespace = node.namespace if isinstance(node.namespace, str) else DEFAULT
    return signature(node.functor, len(node.args), node.negated, namespace or DEFAULT)


def is_constant(node: Any) -> bool:
    """Whether a node is a ground term that needs no computing: it can be made once."""
    match node:
        case syntax.Number() | syntax.String():
            return True
        case syntax.Structure(args=args, annotations=annots, namespace=namespace):
            if namespace is not None and not isinstance(namespace, str):
                return False
            return all(map(is_constant, args)) and (annots is None or is_constant(annots))
        case syntax.ListTerm(items=items, tail=tail):
            return all(map(is_constant, items)) and (tail is None or is_constant(tail))
        case syntax.Arithmetic():
            return is_number(node)
    return False


def is_number(node: Any) -> bool:
    """Whether a node is a numeral, or arithmetic over numerals (but ``div``, which may have no value)."""
    if isinstance(node, syntax.Arithmetic):
        return node.operator != "div" and all(map(is_number, node.operands))
    return isinstance(node, syntax.Number)


def is_plain_atom(node: Any) -> bool:
    """Whether a node is an atom of the default namespace, without decorations."""
    plain = type(node) is syntax.Structure and not node.args and node.annotations is None and not node.negated
    return plain and node.namespace in (None, DEFAULT)


@lru_cache(maxsize=8192)
def shared_atom(name: str) -> Literal:
    """One object per atom of a program, so that generated code can compare by identity first."""
    return atom(name)


def constant_term(node: Any) -> Any:
    """The ground term of a constant node."""
    term = instantiate(node)
    if type(term) is Literal and is_source(term) and type(term.args[0]) is Literal and not term.annots:
        return told_by(term.args[0].sig.functor)[0]
    if isinstance(term, Literal | List):
        term.ground = True
    return term


def constant_annots(node: syntax.ListTerm) -> tuple[Any, ...]:
    """The annotations of a constant list; the same object for the same single source."""
    found = sorted_annots(
        constant_term(item)
        for item in (*node.items, *(node.tail.items if isinstance(node.tail, syntax.ListTerm) else ()))
    )
    if len(found) == 1 and is_source(found[0]) and type(found[0].args[0]) is Literal and not found[0].annots:
        return told_by(found[0].args[0].sig.functor)
    return found
