"""Signatures: what names a predicate, a goal or a structure."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final
from weakref import WeakValueDictionary

DEFAULT: Final = "default"
"""The name of the default namespace."""
THIS_NS: Final = "this_ns"
"""How a program refers to the namespace that it is in."""


class Signature:
    """What two literals must share to unify: namespace, sign, functor and arity. Interned: compare with ``is``.

    Make one with `signature`.
    """

    __slots__ = ("__weakref__", "arity", "functor", "hash", "name", "namespace", "negated")

    functor: str
    arity: int
    negated: bool
    namespace: str
    name: str
    """``~ns::p``: all but the arity."""
    hash: int
    """Its hash, for the terms that it names."""

    def __init__(self, functor: str, arity: int, negated: bool, namespace: str) -> None:
        self.functor, self.arity, self.negated, self.namespace = functor, arity, negated, namespace
        prefix = "" if namespace == DEFAULT else f"{namespace}::"
        self.name = f"{'~' if negated else ''}{prefix}{functor}"
        self.hash = hash(self)

    @property
    def indicator(self) -> str:
        """``~ns::p/2``, as messages name a predicate."""
        return f"{self.name}/{self.arity}"

    def __repr__(self) -> str:
        return self.indicator

    def __reduce__(self) -> Any:
        return signature, (self.functor, self.arity, self.negated, self.namespace)


_signatures: WeakValueDictionary[tuple[str, int, bool, str], Signature] = WeakValueDictionary()


@lru_cache(maxsize=8192)
def signature(functor: str, arity: int = 0, negated: bool = False, namespace: str = DEFAULT) -> Signature:
    """Return the one `Signature` of these values; arity: 0 or more."""
    key = (functor, arity, negated, namespace)
    found = _signatures.get(key)
    if found is None:
        found = _signatures[key] = Signature(functor, arity, negated, namespace)
    return found
