"""Unification, and the copying of terms out of a running plan.

Bindings are written into `Var` cells and noted on a *trail*, a list of the cells bound, so that they can be undone.
Every function that may bind takes the trail as an argument.
"""

from __future__ import annotations

from typing import Any

from agentd.language.instantiate import calculate
from agentd.language.order import sorted_annots
from agentd.language.signatures import DEFAULT, signature
from agentd.language.terms import (
    ARITHMETIC,
    EMPTY,
    MOST_NODES,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Open,
    Var,
    deref,
    elements,
    equal,
    make_list,
    split,
)

Trail = list[Var]


def undo(trail: Trail, mark: int) -> None:
    """Free every variable bound since the trail had the length ``mark``."""
    while len(trail) > mark:
        trail.pop().ref = None


def value(term: Any) -> Any:
    """A term with its chain of variables followed and, if it is arithmetic that can be computed now, its result."""
    term = deref(term)
    if type(term) is Expression and term.operator in ARITHMETIC:
        computed = calculate(term.operator, term.operands)
        return computed if type(computed) is float else term
    return term


def unify(left: Any, right: Any, trail: Trail) -> bool:
    """Make two terms equal by binding variables. Annotations of the left must be a subset of those of the right.

    False leaves the bindings made so far on the trail, for the caller to `undo`.
    """
    pending: list[tuple[Any, Any]] | None = None
    budget = MOST_NODES
    while True:
        left, right = deref(left), deref(right)
        if left is not right:
            kind = type(left)
            if kind is float or kind is str:
                if left != right and not _unify_other(left, right, trail):
                    return False
            elif kind is Literal and type(right) is Literal:
                if left.sig is not right.sig:
                    return False
                if left.annots and not subset(left.annots, right.annots, trail):
                    return False
                if left.args:
                    if pending is None:
                        pending = []
                    pending.extend(zip(reversed(left.args), reversed(right.args), strict=True))
            elif kind is List and type(right) is List:
                if left is EMPTY or right is EMPTY:
                    return False
                if pending is None:
                    pending = []
                pending.append((left.rest(), right.rest()))
                pending.append((left.items[left.at], right.items[right.at]))
            elif not _unify_other(left, right, trail):
                return False
        if not pending:
            return True
        budget -= 1
        if not budget:
            raise RecursionError("a term is cyclic or too large to be unified")
        left, right = pending.pop()


def _unify_other(left: Any, right: Any, trail: Trail) -> bool:
    """The rare pairs: variables, expressions, decorated variables, code."""
    if type(left) is Open:
        return _unify_open(left, right, trail, left_side=True)
    if type(right) is Open:
        return _unify_open(right, left, trail, left_side=False)
    if type(left) is Var:
        return bind(left, right, trail)
    if type(right) is Var:
        return bind(right, left, trail)
    if type(left) is Expression or type(right) is Expression:
        return _unify_expressions(value(left), value(right), trail)
    if type(left) is Code and type(right) is Code:
        from agentd.mind.code_terms import unify_code

        return unify_code(left, right, trail)
    if type(left) is Collection or type(left) is float:
        return bool(left == right)
    return False


def bind(variable: Var, term: Any, trail: Trail) -> bool:
    """Bind a free variable. A plain variable takes no literal of another namespace."""
    term = value(term)
    if term is variable:
        return True
    if type(term) is Literal and term.sig.namespace != DEFAULT:
        return False
    if type(term) is Var and term.depth > variable.depth:
        variable, term = term, variable
    variable.ref = term
    trail.append(variable)
    return True


def _unify_expressions(left: Any, right: Any, trail: Trail) -> bool:
    if type(left) is Expression and type(right) is Expression:
        if left.operator != right.operator or len(left.operands) != len(right.operands):
            return False
        return all(unify(a, b, trail) for a, b in zip(left.operands, right.operands, strict=True))
    if type(left) is Expression or type(right) is Expression:
        return False
    return unify(left, right, trail)


def _unify_open(pattern: Open, other: Any, trail: Trail, left_side: bool) -> bool:
    """Unify a decorated variable with a term: take the decorations off and unify what is left."""
    other = value(other)
    if type(other) is Var:
        other.ref = pattern
        trail.append(other)
        return True
    if type(other) is not Literal:
        if pattern.literal is None and pattern.annots is None and not pattern.negated and pattern.namespace is None:
            return unify(pattern.variable, other, trail)
        return False
    if pattern.literal is not None:
        if pattern.namespace is not None and not _unify_namespace(pattern.namespace, other.sig.namespace, trail):
            return False
        bare = _renamed(other, pattern.literal.sig.namespace, other.sig.negated)
        return unify(pattern.literal, bare, trail) if left_side else unify(bare, pattern.literal, trail)
    if pattern.negated and not other.sig.negated:
        return False
    if pattern.namespace is not None:
        if not _unify_namespace(pattern.namespace, other.sig.namespace, trail):
            return False
    elif other.sig.namespace != DEFAULT:
        return False
    if pattern.annots is not None and not subset(pattern.annots, other.annots, trail):
        return False
    bare = _renamed(other, DEFAULT, other.sig.negated and not pattern.negated)
    if pattern.annots is not None:
        bare = bare.bare()
    return unify(pattern.variable, bare, trail)


def _unify_namespace(namespace: Any, actual: str, trail: Trail) -> bool:
    if isinstance(namespace, str):
        return namespace == actual
    return unify(namespace, Literal(signature(actual)), trail)


def _renamed(literal: Literal, namespace: str, negated: bool) -> Literal:
    sig = literal.sig
    if sig.namespace == namespace and sig.negated == negated:
        return literal
    return Literal(signature(sig.functor, sig.arity, negated, namespace), literal.args, literal.annots)


class Rest:
    """The tail of an annotation list, ``[a|R]``: unifies with the annotations that are left over."""

    __slots__ = ("tail",)

    def __init__(self, tail: Any) -> None:
        self.tail = tail


def annots_with_tail(annots: tuple[Any, ...], tail: Any) -> tuple[Any, ...]:
    """``[a|T]`` as annotations: with the elements of T if it has a value, else T stands for the rest."""
    end = deref(tail)
    if type(end) is Var:
        return (*sorted_annots(annots), Rest(end))
    return sorted_annots((*annots, *elements(end)))


def subset(left: tuple[Any, ...], right: tuple[Any, ...], trail: Trail) -> bool:
    """Whether each annotation on the left unifies with one on the right (the first choice that fits, no backtracking).

    A `Rest` at the end of the left takes what is left over of the right.
    """
    for _ in subsets(left, right, trail):
        return True
    return False


def subsets(left: tuple[Any, ...], right: tuple[Any, ...], trail: Trail) -> Any:
    """One solution after another of ``left`` being a subset of ``right``; bindings are undone between them."""
    if not left:
        yield None
        return
    first, others = left[0], left[1:]
    mark = len(trail)
    if type(first) is Rest:
        if unify(first.tail, make_list(right), trail):
            yield None
        undo(trail, mark)
        return
    keep = bool(others) and type(others[-1]) is Rest
    for i, candidate in enumerate(right):
        if unify(first, candidate, trail):
            yield from subsets(others, right[:i] + right[i + 1 :] if keep else right, trail)
        undo(trail, mark)


def open_structure(term: Any, sig: Any, trail: Trail) -> Any:
    """The arguments of a term that shall be a structure of this signature; None if it is something else.

    A free variable becomes such a structure, with new variables as arguments.
    """
    term = value(term)
    if type(term) is Literal:
        return term.args if term.sig is sig else None
    if type(term) is Var:
        args = tuple(Var() for _ in range(sig.arity))
        return args if bind(term, Literal(sig, args), trail) else None
    return None


def open_list(term: Any, trail: Trail) -> Any:
    """Head and tail of a term that shall be a non-empty list, else None. A free variable becomes such a list."""
    term = deref(term)
    if type(term) is List:
        return None if term is EMPTY else (term.items[term.at], term.rest())
    if type(term) is Var:
        head, tail = Var(), Var()
        bind(term, List((head,), tail), trail)
        return head, tail
    return None


def is_ground(term: Any) -> bool:
    """Whether no free variable is inside."""
    pending = [term]
    budget = MOST_NODES
    while pending:
        budget -= 1
        if not budget:
            raise RecursionError("a term is cyclic or too large")
        term = deref(pending.pop())
        kind = type(term)
        if kind is float or kind is str:
            continue
        if kind is Var or kind is Open:
            return False
        if kind is Literal:
            if not term.ground:
                pending.extend(term.args)
                pending.extend(term.annots)
        elif kind is List:
            while type(term) is List and not term.ground:
                pending.extend(term.items[term.at :])
                term = deref(term.tail)
            if type(term) is not List:
                pending.append(term)
        elif kind is Expression:
            pending.extend(term.operands)
    return True


def _looks_ground(term: Any) -> bool:
    """Whether a flat literal is ground as it stands, found without a walk; notes it in the term."""
    if type(term) is not Literal:
        return False
    for part in (*term.args, *term.annots) if term.annots else term.args:
        kind = type(part)
        if kind is not float and kind is not str and not (kind is Literal and part.ground):
            return False
    term.ground = True
    return True


class Copier:
    """Copies terms out of a plan: bound variables become their values, arithmetic its result.

    Free variables become new ones, the same for the same (``fresh``), or stay.
    """

    __slots__ = ("_fresh", "open")

    def __init__(self, fresh: bool) -> None:
        self._fresh: dict[Var, Var] | None = {} if fresh else None
        self.open = False
        """Whether a free variable was met."""

    def copy(self, term: Any) -> Any:
        term = deref(term)
        kind = type(term)
        if kind is float or kind is str:
            return term
        if (kind is Literal or kind is List) and (term.ground or _looks_ground(term)):
            return term
        return self._deep(term)

    def _deep(self, term: Any) -> Any:
        """Copy without recursion: nodes are opened on the way down and built on the way up."""
        work: list[tuple[Any, bool]] = [(term, False)]
        done: list[Any] = []
        opened: list[bool] = []
        budget = MOST_NODES
        while work:
            budget -= 1
            if not budget:
                raise RecursionError("a term is cyclic or too large to be copied")
            node, build = work.pop()
            if build:
                self._build(node, done, opened)
                continue
            node = deref(node)
            kind = type(node)
            if kind is Literal and not node.ground:
                work.append((node, True))
                work.extend((a, False) for a in reversed(node.args + node.annots))
                opened.append(self.open)
                self.open = False
            elif kind is List and not node.ground:
                items, tail = split(node)
                work.append(((List, len(items), node), True))
                work.append((tail, False))
                work.extend((a, False) for a in reversed(items))
                opened.append(self.open)
                self.open = False
            elif kind is Expression:
                work.append((node, True))
                work.extend((a, False) for a in reversed(node.operands))
            else:
                done.append(self._leaf(node))
        return done[0]

    def _leaf(self, node: Any) -> Any:
        if type(node) is Var:
            self.open = True
            if self._fresh is None:
                return node
            found = self._fresh.get(node)
            if found is None:
                found = self._fresh[node] = Var(node.name)
            return found
        if type(node) is Code and node.values:
            return Code(node.syntax, {name: self.copy(v) for name, v in node.values.items()}, node.bare)
        if type(node) is Rest:
            self.open = True
            return Rest(self.copy(node.tail))
        if type(node) is Open:
            self.open = True
            annots = None if node.annots is None else tuple(self.copy(a) for a in node.annots)
            literal = None if node.literal is None else self.copy(node.literal)
            return Open(self.copy(node.variable), annots, node.negated, node.namespace, literal)
        return node

    def _build(self, node: Any, done: list[Any], opened: list[bool]) -> None:
        if type(node) is Expression:
            operands = tuple(done[-len(node.operands) :])
            del done[-len(node.operands) :]
            computed = calculate(node.operator, operands) if node.operator in ARITHMETIC else None
            done.append(computed if type(computed) is float else Expression(node.operator, operands))
            return
        built: Any
        if type(node) is Literal:
            arity, total = len(node.args), len(node.args) + len(node.annots)
            parts = done[-total:] if total else []
            if total:
                del done[-total:]
            annots = tuple(parts[arity:])
            built = Literal(node.sig, tuple(parts[:arity]), sorted_annots(annots) if len(annots) > 1 else annots)
        else:
            _, count, _ = node
            parts = done[-count - 1 :]
            del done[-count - 1 :]
            built = List(tuple(parts[:-1]), parts[-1])
        built.ground = not self.open
        self.open = self.open or opened.pop()
        done.append(built)


def resolve(term: Any) -> Any:
    """A term without bound variables and without arithmetic that can be computed; free variables stay themselves."""
    kind = type(term)
    if kind is float or kind is str or ((kind is Literal or kind is List) and (term.ground or _looks_ground(term))):
        return term
    return Copier(fresh=False).copy(term)


def resolve_all(terms: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple([resolve(t) for t in terms])


def detach(terms: tuple[Any, ...]) -> tuple[Any, ...]:
    """Terms as another intention or agent gets them: resolved, and their free variables new ones of their own."""
    for term in terms:
        if type(term) is not float and type(term) is not str:
            copier = Copier(fresh=True)
            return tuple([copier.copy(t) for t in terms])
    return terms


def same(left: Any, right: Any) -> bool:
    """``==``: equality without binding, arithmetic computed. Linked free variables are not equal (rule 25)."""
    if type(left) is Literal and type(right) is Literal:
        if left.sig is not right.sig:
            return False
        if left is right:
            return True
    if type(left) is Var and type(right) is Var and left is not right and type(deref(left)) is Var:
        return False
    return equal(resolve(left), resolve(right))
