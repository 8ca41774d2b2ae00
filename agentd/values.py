"""Python values as terms and back, for environments, embedders and internal actions written in Python."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from agentd.language.syntax_tree.signatures import Signature, signature
from agentd.language.terms.terms import (
    FALSE,
    TRUE,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Open,
    Var,
    deref,
    make_list,
    proper,
)

_TERMS = (Literal, List, Var, Expression, Code, Collection, Open)


def term_of(value: Any) -> Any:
    """Return the term for a Python value: numbers, strings, booleans (atoms), lists and tuples; terms stay unchanged.

    Raises TypeError for any other value.
    """
    kind = type(value)
    if kind is float or kind is str:
        return value
    if kind is int:
        return float(value)
    if kind is bool:
        return TRUE if value else FALSE
    if kind in _TERMS:
        return value
    if kind is list or kind is tuple:
        return make_list([term_of(member) for member in value])
    if isinstance(value, (int, float)):
        return float(value)
    raise TypeError(f"{value!r} cannot be a term: numbers, strings, booleans, lists and terms can")


def literal(functor: str, *arguments: Any) -> Literal:
    """Make a structure, or an atom if there are no arguments; arguments are Python values (`term_of`) or terms."""
    args, ground = [], True
    for argument in arguments:
        kind = type(argument)
        if kind is int:
            argument = float(argument)
        elif kind is not float and kind is not str:
            argument = term_of(argument)
            ground = ground and (type(argument) is float or type(argument) is str)
        args.append(argument)
    return Literal(plain_signature(functor, len(args)), tuple(args), (), ground)


@lru_cache(maxsize=4096)
def plain_signature(functor: str, arity: int) -> Signature:
    """Return the signature of a positive literal with `arity` arguments, 0 or more, in the default namespace."""
    return signature(functor, arity)


def value_of(term: Any) -> Any:
    """Return the Python value of a term: float, str, bool for ``true`` and ``false``, list; others stay terms."""
    term = deref(term)
    if type(term) is Literal and not term.annots:
        return True if term == TRUE else False if term == FALSE else term
    members = proper(term)
    return term if members is None else [value_of(member) for member in members]
