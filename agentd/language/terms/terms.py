"""Run-time terms: what beliefs, goals and variables hold while a mind runs.

Numbers are Python floats and strings Python strs, so arithmetic and comparison are the interpreter's own. Everything
else is one of the classes below. Terms are never changed, with two exceptions: a `Var` is bound once (and unbound
again when the plan that bound it fails), and maps, sets and queues are changed in place, as Jason's are.

A term that sits in a belief, an event of a new intention or a message is *resolved* first
(`agentd.mind.beliefs.term_copy`): no bound variable is left inside it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, ClassVar, Final, TypeAlias, Union

from msgspec import Struct

from agentd.language.syntax_tree.signatures import Signature, signature

Term: TypeAlias = Union[float, str, "Literal", "List", "Var", "Expression", "Code", "Collection", "Open"]
"""Any run-time term."""

MOST_NODES: Final = 1_000_000
"""Walking a term with more parts than this ends with RecursionError. It takes a second or two: a part that is in a term
many times counts each time, so forty plans can make one of a million million parts (``X = f(Y,Y)``)."""
MOST_CHARACTERS: Final = 16_000_000
"""Characters of a text that a program makes, of terms or of other texts; a message may have a million bytes."""
PER_PART: Final = 32
"""Characters of a text in a term that count as one part more where a term is copied out of the mind."""
FIRST_NODES: Final = 100_000
"""After this many parts a walk of a term calls `further`, which refuses a cyclic one (``X = f(X)``)."""


class Shown:
    """A term, whose ``repr`` is its text in the language: `agentd.language.terms.format`, once imported, sets
    ``text``."""

    __slots__ = ()

    text: ClassVar[Callable[[Any], str]] = object.__repr__

    def __repr__(self) -> str:
        return Shown.text(self)


class Literal(Shown, Struct, eq=False):
    """An atom, structure or literal: a signature, its arguments and its annotations (sorted, without duplicates).

    Equality is that of ``==`` in the language: same signature, equal arguments, equal annotations. It is a struct, as C
    code makes those.
    """

    sig: Signature
    args: tuple[Any, ...] = ()
    annots: tuple[Any, ...] = ()
    ground: bool = False
    """True once a search has found no variable inside; False means only that there was no search."""

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if type(other) is not Literal or self.sig is not other.sig:
            return False
        return (not self.sig.arity and self.annots == other.annots) or equal(self, other)

    def __ne__(self, other: object) -> bool:
        return not self == other  # a struct's own would compare identities

    def __hash__(self) -> int:
        if not self.args:
            return self.sig.hash
        # Depth 2 only, so that the hash of a deeply nested term costs nothing and needs no recursion.
        return hash((self.sig, *[a.sig if type(a) is Literal else a for a in self.args if type(a) is not List]))

    @property
    def functor(self) -> str:
        """Its name, without namespace, sign and arity."""
        return self.sig.functor

    def with_annots(self, annots: tuple[Any, ...]) -> Literal:
        """Return the same literal with other annotations (sorted already)."""
        return Literal(self.sig, self.args, annots)

    def bare(self) -> Literal:
        """Return the same literal without annotations."""
        return Literal(self.sig, self.args) if self.annots else self


class List(Shown):
    """A non-empty list, or `EMPTY`: the elements ``items[at:]`` followed by ``tail``.

    ``tail`` is `EMPTY`, another list, a `Var`, or (deviation D3) any other term. Taking the tail of a list shares its
    items, so a list made in one step costs one object however long it is.
    """

    __slots__ = ("at", "ground", "items", "tail")

    items: tuple[Any, ...]
    at: int
    tail: Any
    ground: bool

    def __init__(self, items: tuple[Any, ...], tail: Any, at: int = 0) -> None:
        self.items, self.tail, self.at = items, tail, at
        self.ground = False

    @property
    def head(self) -> Any:
        """The first element."""
        return self.items[self.at]

    def rest(self) -> Any:
        """Return what follows the first element."""
        at = self.at + 1
        if at == len(self.items):
            return self.tail
        rest = List(self.items, self.tail, at)
        rest.ground = self.ground
        return rest

    def __eq__(self, other: object) -> bool:
        return self is other or (type(other) is List and equal(self, other))

    def __hash__(self) -> int:
        return hash(self.items[self.at]) if self.items and type(self.items[self.at]) is not List else 0


EMPTY: Final = List((), None)
"""The empty list, the only one without elements: compare with ``is``."""
EMPTY.ground = True


class Var(Shown):
    """A variable while a plan runs: free (``ref`` is None) or bound to a term.

    ``depth`` is the depth in its intention's stack of the frame that made it: a binding must be remembered for undoing
    only as long as a frame above that one may fail.
    """

    __slots__ = ("depth", "name", "ref")

    name: str
    ref: Any
    depth: int

    def __init__(self, name: str = "_", depth: int = 1 << 30) -> None:
        self.name, self.depth = name, depth
        self.ref = None


class Expression(Shown):
    """An operator over terms that has no value (yet): ``X+1`` with X free, ``a & b``, ``not c``, ``1 < 2`` as a term.

    ``operator`` is one of `ARITHMETIC`, a relation, ``&``, ``|`` or ``not``; one or two operands.
    """

    __slots__ = ("operands", "operator", "waits_for")

    operator: str
    operands: tuple[Any, ...]
    waits_for: Var | None
    """A variable inside that was free when the value was asked for last: as long as it is, there is no value."""

    def __init__(self, operator: str, operands: tuple[Any, ...], waits_for: Var | None = None) -> None:
        self.operator, self.operands, self.waits_for = operator, operands, waits_for

    def __eq__(self, other: object) -> bool:
        return self is other or (type(other) is Expression and equal(self, other))

    def __hash__(self) -> int:
        return hash(self.operator)


ARITHMETIC: Final = frozenset({"+", "-", "*", "/", "**", "div", "mod"})
"""The operators whose expressions are computed as soon as their operands are numbers."""


class Open(Shown):
    """A variable with decorations, ``~X``, ``ns::X``, ``X[a]``, or a literal in a variable namespace, ``N::p(1)``.

    It means something only to unification: ``variable`` unifies with the term without the decorations.
    ``namespace`` is a name, a `Var`, or None when none is written. For a literal, ``literal`` is it (else None).
    """

    __slots__ = ("annots", "literal", "namespace", "negated", "variable")

    def __init__(
        self,
        variable: Any,
        annots: tuple[Any, ...] | None,
        negated: bool,
        namespace: Any,
        literal: Literal | None = None,
    ) -> None:
        self.variable, self.annots, self.negated, self.namespace = variable, annots, negated, namespace
        self.literal = literal


class Rest:
    """The tail of an annotation list, ``[a|R]``: unifies with the annotations that are left over."""

    __slots__ = ("tail",)

    def __init__(self, tail: Any) -> None:
        self.tail = tail


class Code(Shown):
    """A plan, trigger, plan body or rule as a term: its syntax, and the values of the variables bound when it was made.

    ``syntax`` is an `agentd.language.syntax_tree.nodes` ``Plan``, ``Trigger``, ``Body`` or ``Rule``; ``values`` maps
    variable names to terms. Free variables stay names: a body run by a plan sees the variables of that plan. ``bare``
    marks a part taken out of a plan term by ``=..``, which prints without braces.
    """

    __slots__ = ("bare", "syntax", "values")

    def __init__(self, syntax: Any, values: dict[str, Any] | None = None, bare: bool = False) -> None:
        self.syntax, self.values, self.bare = syntax, values or {}, bare

    def __eq__(self, other: object) -> bool:
        return type(other) is Code and self.syntax == other.syntax and self.values == other.values

    def __hash__(self) -> int:
        return hash(type(self.syntax))


class Collection(Shown):
    """A map, set or queue: changed in place, shared by every variable that holds it; equal only by contents."""

    __slots__ = ("content", "kind")

    kind: str
    """``map``, ``set``, ``queue`` or ``priority`` (a queue kept in standard order)."""
    content: Any
    """A dict for a map, else a list; sets are kept sorted without duplicates."""

    def __init__(self, kind: str, content: Any) -> None:
        self.kind, self.content = kind, content

    def __eq__(self, other: object) -> bool:
        return type(other) is Collection and self.kind == other.kind and bool(self.content == other.content)

    def __hash__(self) -> int:
        return hash(self.kind)


def atom(name: str) -> Literal:
    """Return an atom of the default namespace, without annotations."""
    return Literal(signature(name), ground=True)


TRUE: Final = atom("true")
FALSE: Final = atom("false")


class LargeLists:
    """The number of lists of more than `LARGE_LIST` elements that this process has made; checkpoints look at it."""

    made = 0


LARGE_LIST: Final = 5_000


def make_list(items: Iterable[Any], tail: Any = EMPTY) -> Any:
    """Return the list of these elements, ended by ``tail``."""
    elements = tuple(items)
    if len(elements) > LARGE_LIST:
        LargeLists.made += 1
    return List(elements, tail) if elements else tail


def deref(term: Any) -> Any:
    """Return the term at the end of a chain of bound variables."""
    while type(term) is Var and term.ref is not None:
        term = term.ref
    return term


def elements(term: Any) -> Iterator[Any]:
    """Yield the elements of a list, whatever its end; nothing if it is no list."""
    for span in spans(term):
        yield from span.items[span.at :] if span.at else span.items


def spans(term: Any) -> Iterator[List]:
    """Yield the lists of which each is the tail of the one before; raises RecursionError if they go round."""
    term = deref(term)
    budget, rest = FIRST_NODES, MOST_NODES
    while type(term) is List and term is not EMPTY:
        yield term
        term = deref(term.tail)
        budget -= 1
        if not budget:
            budget, rest = further(rest, (term,), "gone through")


def split(term: Any) -> tuple[list[Any], Any]:
    """Return the elements of a list and what ends it (`EMPTY` for a proper list)."""
    end = deref(term)
    found: list[Any] = []
    for span in spans(end):
        found.extend(span.items[span.at :] if span.at else span.items)
        end = deref(span.tail)
    return found, end


def proper(term: Any) -> list[Any] | None:
    """Return the elements of a closed list; None for anything else."""
    term = deref(term)
    if type(term) is not List:
        return None
    found, end = split(term)
    return found if end is EMPTY else None


def equal(left: Any, right: Any) -> bool:
    """Equality of terms at any depth without recursion: bound variables are their values, free ones only themselves."""
    pending = [(left, right)]
    budget, rest = FIRST_NODES, MOST_NODES
    while pending:
        a, b = pending.pop()
        a, b = deref(a), deref(b)
        if a is b:
            continue
        budget -= 1
        if not budget:
            budget, rest = further(rest, pending, "compared")
        kind = type(a)
        if kind is not type(b):
            return False
        if kind is Literal:
            if a.sig is not b.sig or len(a.annots) != len(b.annots):
                return False
            pending.extend(zip(a.args, b.args, strict=True))
            pending.extend(zip(a.annots, b.annots, strict=True))
        elif kind is List:
            if a is EMPTY or b is EMPTY:
                return False
            pending.append((a.rest(), b.rest()))
            pending.append((a.items[a.at], b.items[b.at]))
        elif kind is Expression:
            if a.operator != b.operator or len(a.operands) != len(b.operands):
                return False
            pending.extend(zip(a.operands, b.operands, strict=True))
        elif kind is Var or kind is Open or a != b:
            return False
    return True


def further(rest: int, pending: Iterable[Any], what: str) -> tuple[int, int]:
    """Return the number of parts of a term that may be walked next, and the number after those.

    ``pending`` is what is still to be walked (terms, or tuples with terms in them), ``rest`` how many parts were left
    to the walk and ``what`` was to be done with the term. Raises RecursionError for a cyclic or too large one.
    """
    if not rest or _cyclic(pending):
        raise RecursionError(f"a term is {'cyclic' if rest else 'too large to be ' + what}")
    return rest, 0


def _cyclic(roots: Iterable[Any]) -> bool:
    """Return whether a term holds itself. Each part is visited one time."""
    path: set[int] = set()
    done: set[int] = set()
    work: list[tuple[Any, bool]] = [(root, False) for root in roots]
    while work:
        node, left = work.pop()
        if left:
            path.discard(id(node))
            done.add(id(node))
        elif id(node) in path:
            return True
        elif id(node) not in done and (parts := parts_of(node)):
            path.add(id(node))
            work.append((node, True))
            work.extend((part, False) for part in parts)
    return False


def parts_of(node: Any) -> tuple[Any, ...]:
    """Return the parts of a term, or of a tuple of terms."""
    match node:
        case tuple():
            return node
        case Literal():
            return node.args + node.annots
        case List():
            return (*node.items[node.at :], node.tail) if node is not EMPTY else ()
        case Var():
            return () if node.ref is None else (node.ref,)
        case Expression():
            return tuple(node.operands)
    return ()
