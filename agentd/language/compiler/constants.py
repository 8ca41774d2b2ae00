"""What of a program is known before it runs: signatures, and ground terms, which are made once."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, TypeGuard

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT, Signature, signature
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import is_source, told_by
from agentd.language.terms.terms import List, Literal, atom


def signature_of(node: nodes.Structure) -> Signature:
    """Return the signature of a literal whose namespace is known."""
    namespace = node.namespace if isinstance(node.namespace, str) else DEFAULT
    return signature(node.functor, len(node.args), node.negated, namespace or DEFAULT)


def is_constant(node: Any) -> bool:
    """Return whether a node is a ground term that needs no computing: it can be made once."""
    pending: list[Any] = [node]
    while pending:
        node = pending.pop()
        kind = type(node)
        if kind is nodes.Number or kind is nodes.String:
            continue
        if kind is nodes.Structure:
            if node.namespace is not None and not isinstance(node.namespace, str):
                return False
            pending.extend(node.args)
            if node.annotations is not None:
                pending.append(node.annotations)
        elif kind is nodes.ListTerm:
            pending.extend(node.items)
            if node.tail is not None:
                pending.append(node.tail)
        elif kind is not nodes.Arithmetic or not is_number(node):
            return False
    return True


def is_number(node: object) -> bool:
    """Return whether a node is a numeral, or arithmetic over numerals (but ``div``, which may have no value)."""
    pending: list[object] = [node]
    while pending:
        node = pending.pop()
        if type(node) is nodes.Arithmetic and node.operator != "div":
            pending.extend(node.operands)
        elif type(node) is not nodes.Number:
            return False
    return True


def is_plain_atom(node: object) -> TypeGuard[nodes.Structure]:
    """Return whether a node is an atom of the default namespace, without decorations."""
    if type(node) is not nodes.Structure or node.args or node.annotations is not None or node.negated:
        return False
    return node.namespace is None or node.namespace == DEFAULT


@lru_cache(maxsize=8192)
def shared_atom(name: str) -> Literal:
    """One object per atom of a program, so that generated code can compare by identity first."""
    return atom(name)


def constant_term(node: nodes.Term) -> Any:
    """Return the ground term of a constant node."""
    term = instantiate(node)
    if type(term) is Literal and is_source(term) and type(term.args[0]) is Literal and not term.annots:
        return told_by(term.args[0].sig.functor)[0]
    if isinstance(term, Literal | List):
        term.ground = True
    return term


def constant_annots(node: nodes.ListTerm) -> tuple[Any, ...]:
    """Return the annotations of a constant list; the same object for the same single source."""
    found = sorted_annots(
        constant_term(item)
        for item in (*node.items, *(node.tail.items if isinstance(node.tail, nodes.ListTerm) else ()))
    )
    if len(found) == 1 and is_source(found[0]) and type(found[0].args[0]) is Literal and not found[0].annots:
        return told_by(found[0].args[0].sig.functor)
    return found
