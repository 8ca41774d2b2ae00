"""Copy terms out of a running plan, so that they outlive its bindings: in beliefs, events and messages."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.from_ast import calculate
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import SELF, SOURCE_SELF, is_source, source, told_by
from agentd.language.terms.terms import (
    ARITHMETIC,
    FIRST_NODES,
    MOST_NODES,
    Code,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Term,
    Var,
    atom,
    deref,
    elements,
    further,
    split,
)


def resolve(term: Any) -> Any:
    """Return a term without bound variables and computable arithmetic; free variables stay themselves."""
    kind = type(term)
    if kind is float or kind is str or (kind is Literal and (term.ground or _looks_ground(term))):
        return term
    return Copier(fresh=False).copy(term)


def resolve_all(terms: tuple[Any, ...]) -> tuple[Any, ...]:
    """Resolve each of the terms; the same tuple if nothing changes."""
    for term in terms:
        kind = type(term)
        if kind is not float and kind is not str and not ((kind is Literal or kind is List) and term.ground):
            return tuple([resolve(t) for t in terms])
    return terms


def resolve_annots(annots: tuple[Any, ...]) -> tuple[Any, ...]:
    """Annotations as a belief or event keeps them: resolved, with the elements of a bound tail, without a free one."""
    for annot in annots:
        if type(annot) is not Literal or not annot.ground:
            break
    else:
        return annots
    found = resolve_all(annots)
    if type(found[-1]) is Rest:
        return sorted_annots((*found[:-1], *elements(found[-1].tail)))
    return found


def detach(terms: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return terms as another intention or agent gets them: resolved, with free variables of their own."""
    for term in terms:
        kind = type(term)
        if kind is not float and kind is not str and not ((kind is Literal or kind is List) and term.ground):
            copier = Copier(fresh=True)
            return tuple([copier.copy(t) for t in terms])
    return terms


def detached(term: Any) -> Any:
    """As `detach`, for one term."""
    kind = type(term)
    if (kind is Literal and (term.ground or _looks_ground(term))) or kind is float or kind is str:
        return term
    return Copier(fresh=True).copy(term)


def closed(term: Open) -> Any:
    """Return the literal that ``X[a]``, ``~X``, ``ns::X`` or ``N::p(1)`` becomes with values; before, itself."""
    literal = deref(term.variable) if term.literal is None else term.literal
    namespace = deref(term.namespace)
    if type(literal) is not Literal or type(namespace) is Var:
        return term
    sig = literal.sig
    if type(namespace) is Literal:
        namespace = namespace.sig.functor
    annots = literal.annots if not term.annots else sorted_annots(literal.annots + term.annots)
    sig = signature(sig.functor, sig.arity, sig.negated or term.negated, namespace or sig.namespace)
    return Literal(sig, literal.args, annots)


def is_ground(term: Any) -> bool:
    """Return whether no free variable is inside."""
    pending = [term]
    budget, rest = FIRST_NODES, MOST_NODES
    while pending:
        budget -= 1
        if not budget:
            budget, rest = further(rest, pending, "looked through")
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
            if not term.ground:
                pending.extend(term.items[term.at :])
                pending.append(term.tail)
        elif kind is Expression:
            pending.extend(term.operands)
    return True


def _looks_ground(term: Literal) -> bool:
    """Return whether a flat literal is ground, found without a walk and noted in the term."""
    for part in (*term.args, *term.annots) if term.annots else term.args:
        kind = type(part)
        if kind is not float and kind is not str and not (kind is Literal and part.ground):
            return False
    term.ground = True
    return True


class Copier:
    """Copies terms out of a plan: bound variables become their values, arithmetic its result.

    With ``fresh`` each free variable is replaced by a new one; ``known`` maps those that were replaced before.
    """

    __slots__ = ("_fresh", "open")

    def __init__(self, fresh: bool, known: dict[Var, Var] | None = None) -> None:
        self._fresh: dict[Var, Var] | None = ({} if known is None else known) if fresh else None
        self.open = False
        """Whether a free variable was met."""

    def copy(self, term: Any) -> Any:
        """Copy a term; equal variables stay equal."""
        term = deref(term)
        kind = type(term)
        if kind is float or kind is str:
            return term
        if (kind is Literal and (term.ground or _looks_ground(term))) or (kind is List and term.ground):
            return term
        flat = self._flat(term) if kind is Literal and not term.annots else None
        return self._deep(term) if flat is None else flat

    def _flat(self, term: Literal) -> Literal | None:
        """Copy a literal whose arguments are numbers, texts, ground literals and variables, as most are that are
        not ground; None for another one."""
        args, ground = [], True
        for arg in term.args:
            if type(arg) is Var:
                arg = deref(arg)
            kind = type(arg)
            if kind is Var:
                arg, ground = self._leaf(arg), False
            elif kind is not float and kind is not str and not (kind is Literal and arg.ground):
                return None
            args.append(arg)
        return Literal(term.sig, tuple(args), (), ground)

    def _deep(self, term: Term) -> Any:
        """Copy without recursion: nodes are opened on the way down and built on the way up.

        A large term is copied with its sharing: each part once, however often it is in the term.
        """
        work: list[tuple[Any, bool]] = [(term, False)]
        done: list[Term] = []
        opened: list[bool] = []
        budget, rest = FIRST_NODES, MOST_NODES
        shared: dict[int, Any] | None = None
        while work:
            budget -= 1
            if not budget:
                budget, rest = further(rest, work, "copied")
                shared = {}
            node, build = work.pop()
            if build:
                self._build(node, done, opened)
                if shared is not None:
                    shared[id(node[2] if type(node) is tuple else node)] = done[-1]
                continue
            node = deref(node)
            kind = type(node)
            if shared is not None and (copied := shared.get(id(node))) is not None:
                done.append(copied)
                self.open = self.open or kind is Expression or not copied.ground
            elif kind is Literal and not node.ground:
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
            if annots and type(annots[-1]) is Rest and type(annots[-1].tail) is List:
                annots = (*annots[:-1], *elements(annots[-1].tail))
            built = Literal(node.sig, tuple(parts[:arity]), sorted_annots(annots) if len(annots) > 1 else annots)
        else:
            _, count, _ = node
            parts = done[-count - 1 :]
            del done[-count - 1 :]
            built = List(tuple(parts[:-1]), parts[-1])
        built.ground = not self.open
        self.open = self.open or opened.pop()
        done.append(built)


# --- annotations ---


def with_source(annots: tuple[Term, ...]) -> tuple[Term, ...]:
    """Annotations with source(self) added if they name no source."""
    if not annots:
        return SELF
    if any(is_source(a) for a in annots):
        return annots
    return sorted_annots(annots + SELF)


def annots_with_tail(annots: tuple[Term, ...], tail: Term) -> tuple[Term, ...]:
    """``[a|T]`` as annotations: with the elements of T if it has a value, else with T as a `Rest`."""
    end = deref(tail)
    if type(end) is Var:
        return (*sorted_annots(annots), Rest(end))
    return sorted_annots((*annots, *elements(end)))


def nested_source(annots: tuple[Term, ...], name: str) -> tuple[Term, ...]:
    """Annotations of an agent's message: its sources, except source(self), become annotations of source(name)."""
    if not annots or annots == SELF:
        return SELF if name == "self" else told_by(name)
    others = [a for a in annots if not is_source(a)]
    inner = tuple(a for a in annots if is_source(a) and a != SOURCE_SELF)
    who = source(atom(name))
    return sorted_annots((*others, who.with_annots(inner) if inner else who))
