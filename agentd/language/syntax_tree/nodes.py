"""The abstract syntax of a program: what the parser makes and the compiler reads.

The tree says what was written and where, and decides nothing: namespaces, patterns such as ``dg``, functions and
internal actions are resolved by the compiler. Every node is frozen; its ``position`` is where it begins and takes no
part in comparisons, so two nodes are equal when they say the same.

How to write each construct of the dialect (`Structure` is the workhorse, also of atoms):

=====================================  ================================================================================
``12``  ``"text"``                     `Number` (always float), `String` (with ``\\n`` and ``\\"`` already translated)
``a``  ``'a b'``  ``true``             `Structure` without arguments; a quoted atom keeps its quotes in ``functor``
``p(1)[x|R]``                          `Structure` with ``annotations=ListTerm((x,), tail=R)``; no annotations: ``None``
``~p``  ``ns::p``  ``N::p``  ``::p``   ``negated=True``; ``namespace="ns"``, ``Variable("N")``, ``""``; else ``None``
``X``  ``_``  ``~X[a]``  ``ns::X``     `Variable`, decorated alike; ``_`` is ``Variable("_")`` each time
``.f(1)``  ``math.max(1,2)``  ``a.b``  `InternalAction`: any functor with a dot, be it a formula, a function or an atom
``[a,b|T]``                            `ListTerm`
``X+1``  ``-X``                        `Arithmetic` with two operands, or one (``-`` and ``+``)
``X < 1``  ``X = Y``  ``P =.. L``      `Relation`
``not p``  ``a & b``  ``a | b``        `Not`, `And`, `Or`; formulas are terms too
``{ @l +!g : c <- b }``                `PlanTerm`, as soon as there is a label, a context, ``<:`` or ``<-``
``{ +!g }``  ``{ -b(1) }``  ``{+b}``   `TriggerTerm`: one single ``+ - ^`` formula that can be a trigger
``{ !a; +b }``  ``{ !a }``  ``{ }``    `BodyTerm`: every other body in braces
``{ h(X) :- b(X) }``                   `RuleTerm`
=====================================  ================================================================================
"""

from __future__ import annotations

import enum
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from msgspec import Struct, field

if TYPE_CHECKING:
    from schemas.files.findings import Finding


class Position(Struct, frozen=True):
    """Where something begins in its source: ``file`` as the user named it, ``line``, ``column`` from 1 (0: unknown)."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


NOWHERE = Position("", 0, 0)
"""The position of nodes that are made without source text."""
_NOT_COMPARED: Final = frozenset(("position", "scoped", "this_ns"))


class Node(Struct, frozen=True, eq=False, repr_omit_defaults=True):
    """A part of the tree. All classes but `Belief` derive from it."""

    def _compared(self) -> tuple[Any, ...]:
        return tuple([getattr(self, name) for name in self.__struct_fields__ if name not in _NOT_COMPARED])

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._compared() == other._compared()

    def __ne__(self, other: object) -> bool:  # that of `Struct` compares all fields
        return not self == other

    def __hash__(self) -> int:
        return hash(self._compared())


class Number(Node, frozen=True, eq=False):
    """A numeral; every number of the dialect is a double. A minus before it is an `Arithmetic` of one operand."""

    value: float
    position: Position = NOWHERE


class String(Node, frozen=True, eq=False):
    """A string with its escapes already translated and without its quotes."""

    value: str
    position: Position = NOWHERE


class Variable(Node, frozen=True, eq=False):
    """A variable; names that begin with ``_`` are anonymous: each occurrence is another variable."""

    name: str
    annotations: ListTerm | None = None
    negated: bool = False
    namespace: str | Variable | None = None
    position: Position = NOWHERE

    @property
    def anonymous(self) -> bool:
        """Whether it is ``_``, or begins with it."""
        return self.name.startswith("_")


class Structure(Node, frozen=True, eq=False):
    """An atom, structure or literal. ``annotations`` is None when none are written, else a list (maybe ``[]``)."""

    functor: str
    args: tuple[Term, ...] = ()
    annotations: ListTerm | None = None
    negated: bool = False
    namespace: str | Variable | None = None
    position: Position = NOWHERE


class InternalAction(Node, frozen=True, eq=False):
    """``.print("x")``, ``math.max(1,2)``, ``my.action``: a functor with a dot. ``name`` is as written (``.print``)."""

    name: str
    args: tuple[Term, ...] = ()
    position: Position = NOWHERE


class ListTerm(Node, frozen=True, eq=False):
    """``[a,b|T]``; ``tail`` is None for a closed list. A list tail written out (``[a|[b]]``) stays as written."""

    items: tuple[Term, ...] = ()
    tail: Variable | ListTerm | None = None
    position: Position = NOWHERE


class Arithmetic(Node, frozen=True, eq=False):
    """``operator`` is one of ``+ - * / ** div mod``; one operand for unary minus and plus."""

    operator: str
    operands: tuple[Term, ...]
    position: Position = NOWHERE


class Relation(Node, frozen=True, eq=False):
    """``operator`` is one of ``< <= > >= == \\== = =..``."""

    operator: str
    left: Term
    right: Term
    position: Position = NOWHERE


class Not(Node, frozen=True, eq=False):
    """``not F``."""

    operand: Term
    position: Position = NOWHERE


class And(Node, frozen=True, eq=False):
    """``F & G``."""

    left: Term
    right: Term
    position: Position = NOWHERE


class Or(Node, frozen=True, eq=False):
    """``F | G``."""

    left: Term
    right: Term
    position: Position = NOWHERE


CONNECTIVES: Final[dict[type, str]] = {And: "&", Or: "|", Not: "not"}


class PlanTerm(Node, frozen=True, eq=False):
    """A plan in braces as a term."""

    plan: Plan
    position: Position = NOWHERE


class TriggerTerm(Node, frozen=True, eq=False):
    """A trigger in braces as a term."""

    trigger: Trigger
    position: Position = NOWHERE


class BodyTerm(Node, frozen=True, eq=False):
    """A plan body in braces as a term. ``{ H; T }`` is a body whose steps are two variables."""

    body: Body
    position: Position = NOWHERE


class RuleTerm(Node, frozen=True, eq=False):
    """A rule in braces as a term."""

    rule: Rule
    position: Position = NOWHERE


Term: TypeAlias = (
    Number
    | String
    | Variable
    | Structure
    | InternalAction
    | ListTerm
    | Arithmetic
    | Relation
    | Not
    | And
    | Or
    | PlanTerm
    | TriggerTerm
    | BodyTerm
    | RuleTerm
)

Formula: TypeAlias = Structure | Variable | InternalAction | Relation | Not | And | Or
"""A term that can be a context, a rule body or a test."""


class Operator(enum.Enum):
    """What a `Step` does with its term; the value is how it is written."""

    ACTION = ""
    """A `Structure` (external action), `InternalAction`, `Variable` (runs what it holds), or a bare formula:
    `Relation` (``X = 1``), `Not`, `And`, `Or` in brackets."""
    ACHIEVE = "!"
    ACHIEVE_NEW_FOCUS = "!!"
    TEST = "?"
    ADD = "+"
    ADD_NEW_FOCUS = "++"
    ADD_FIRST = "+<"
    ADD_LAST = "+>"
    DELETE = "-"
    DELETE_NEW_FOCUS = "--"
    UPDATE = "-+"


class Step(Node, frozen=True, eq=False):
    """A formula of a body: an operator and its term (of ``+{ plan }`` a `PlanTerm`, of ``+{ rule }`` a `RuleTerm`)."""

    operator: Operator
    term: Term
    position: Position = NOWHERE


class If(Node, frozen=True, eq=False):
    """``if (c) {..} elif (d) {..} else {..}``; ``otherwise`` is None without an else."""

    branches: tuple[tuple[Formula, Body], ...]
    otherwise: Body | None = None
    position: Position = NOWHERE


class While(Node, frozen=True, eq=False):
    """``while (F) { ... }``."""

    condition: Formula
    body: Body
    position: Position = NOWHERE


class For(Node, frozen=True, eq=False):
    """``for (F) { ... }``."""

    condition: Formula
    body: Body
    position: Position = NOWHERE


class Fork(Node, frozen=True, eq=False):
    """``a |&| b |&| c`` (``operator="|&|"``) or ``a ||| b``; a branch in brackets is a body of several steps."""

    operator: str
    branches: tuple[Body, ...]
    position: Position = NOWHERE


BodyFormula: TypeAlias = Step | If | While | For | Fork


class Body(Node, frozen=True, eq=False):
    """The formulas of a plan, block or bracketed sequence, in order; may be empty."""

    formulas: tuple[BodyFormula, ...] = ()
    position: Position = NOWHERE


class Trigger(Node, frozen=True, eq=False):
    """``+!g(X)[source(S)]``: ``operator`` is ``+ - ^``, ``goal`` is ``""`` (belief), ``"!"`` or ``"?"``."""

    operator: str
    goal: str
    literal: Structure | Variable
    position: Position = NOWHERE


class Plan(Node, frozen=True, eq=False):
    """``@label[annots] trigger : context <: goal_condition <- body. { subplans }``

    ``label`` is None when there is none, a variable only in a `PlanTerm` (``{ @L +!g } = P``);
    ``@[tag]`` is a `Structure` with the functor ``""`` and annotations.
    ``body`` is empty for ``+!g.`` and ``+!g : c.``; ``<- true`` stays a body of one step, as written.
    """

    trigger: Trigger
    context: Formula | None = None
    body: Body = field(default_factory=Body)
    label: Structure | Variable | None = None
    goal_condition: Formula | None = None
    subplans: tuple[Plan, ...] = ()
    position: Position = NOWHERE


class Belief:
    """An initial belief, ``p(1)[a].``; its arguments may be arithmetic. Never changed.

    No `Node`, as that of a large program has its syntax only on demand (`agentd.language.parser.fact_runs`).
    """

    __slots__ = ("literal", "position")
    __match_args__ = ("literal", "position")

    literal: Structure
    position: Position

    def __init__(self, literal: Structure, position: Position = NOWHERE) -> None:
        self.literal, self.position = literal, position

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Belief) and self.literal == other.literal

    def __hash__(self) -> int:
        return hash(self.literal)

    def __repr__(self) -> str:
        return f"Belief(literal={self.literal!r})"


class Rule(Node, frozen=True, eq=False):
    """``head :- body.``"""

    head: Structure
    body: Formula
    position: Position = NOWHERE


class Goal(Node, frozen=True, eq=False):
    """An initial goal, ``!g.`` (or ``?g.`` with ``operator="?"``)."""

    literal: Structure
    operator: str = "!"
    position: Position = NOWHERE


class Directive(Node, frozen=True, eq=False):
    """``{ include("f.asl", n) }``, or with ``items`` (not None) a block ``{ begin namespace(n) } ... { end }``.

    ``name`` is the directive with its arguments: ``Structure("include", (String("f.asl"), Structure("n")))``.
    """

    name: Structure
    items: tuple[Item, ...] | None = None
    position: Position = NOWHERE


Item: TypeAlias = Belief | Rule | Goal | Plan | Directive


class Program(Node, frozen=True, eq=False):
    """A source file: its items in file order, and the warnings of the parser (deviation D1 and the like).

    ``scoped``: it may name a namespace; ``this_ns``: it may contain the atom of that name.
    """

    file: str
    items: tuple[Item, ...] = ()
    warnings: tuple[Finding, ...] = ()
    scoped: bool = False
    this_ns: bool = False

    def plans(self) -> Iterator[Plan]:
        """Yield all plans, also those in blocks, in file order; sub-plans stay inside their plan."""
        yield from (item for item in _flat(self.items) if isinstance(item, Plan))


def _flat(items: tuple[Item, ...]) -> Iterator[Item]:
    for item in items:
        yield item
        if isinstance(item, Directive) and item.items:
            yield from _flat(item.items)


def fields_of(kind: type) -> tuple[str, ...]:
    """Return the names of the fields of a class of nodes, in order; none for any other class."""
    if issubclass(kind, Node):
        return kind.__struct_fields__
    return Belief.__match_args__ if issubclass(kind, Belief) else ()
