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
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from schemas.files.findings import Finding


@dataclass(frozen=True, slots=True)
class Position:
    """Where something begins in its source: ``file`` as the user named it, ``line``, ``column`` from 1 (0: unknown)."""

    file: str
    line: int
    column: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


NOWHERE = Position("", 0, 0)
"""The position of nodes that are made without source text."""


@dataclass(frozen=True, slots=True)
class Number:
    """A numeral; every number of the dialect is a double. A minus before it is an `Arithmetic` of one operand."""

    value: float
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class String:
    """A string with its escapes already translated and without its quotes."""

    value: str
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable; names that begin with ``_`` are anonymous: each occurrence is another variable."""

    name: str
    annotations: ListTerm | None = None
    negated: bool = False
    namespace: str | Variable | None = None
    position: Position = field(default=NOWHERE, compare=False, repr=False)

    @property
    def anonymous(self) -> bool:
        return self.name.startswith("_")


@dataclass(frozen=True, slots=True)
class Structure:
    """An atom, structure or literal. ``annotations`` is None when none are written, else a list (maybe ``[]``)."""

    functor: str
    args: tuple[Term, ...] = ()
    annotations: ListTerm | None = None
    negated: bool = False
    namespace: str | Variable | None = None
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class InternalAction:
    """``.print("x")``, ``math.max(1,2)``, ``my.action``: a functor with a dot. ``name`` is as written (``.print``)."""

    name: str
    args: tuple[Term, ...] = ()
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class ListTerm:
    """``[a,b|T]``; ``tail`` is None for a closed list. A list tail written out (``[a|[b]]``) stays as written."""

    items: tuple[Term, ...] = ()
    tail: Variable | ListTerm | None = None
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Arithmetic:
    """``operator`` is one of ``+ - * / ** div mod``; one operand for unary minus and plus."""

    operator: str
    operands: tuple[Term, ...]
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Relation:
    """``operator`` is one of ``< <= > >= == \\== = =..``."""

    operator: str
    left: Term
    right: Term
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Not:
    operand: Term
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class And:
    left: Term
    right: Term
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Or:
    left: Term
    right: Term
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class PlanTerm:
    """A plan in braces as a term."""

    plan: Plan
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class TriggerTerm:
    """A trigger in braces as a term."""

    trigger: Trigger
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class BodyTerm:
    """A plan body in braces as a term. ``{ H; T }`` is a body whose steps are two variables."""

    body: Body
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RuleTerm:
    """A rule in braces as a term."""

    rule: Rule
    position: Position = field(default=NOWHERE, compare=False, repr=False)


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


@dataclass(frozen=True, slots=True)
class Step:
    """A formula of a body: an operator and its term (of ``+{ plan }`` a `PlanTerm`, of ``+{ rule }`` a `RuleTerm`)."""

    operator: Operator
    term: Term
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class If:
    """``if (c) {..} elif (d) {..} else {..}``; ``otherwise`` is None without an else."""

    branches: tuple[tuple[Formula, Body], ...]
    otherwise: Body | None = None
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class While:
    condition: Formula
    body: Body
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class For:
    condition: Formula
    body: Body
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Fork:
    """``a |&| b |&| c`` (``operator="|&|"``) or ``a ||| b``; a branch in brackets is a body of several steps."""

    operator: str
    branches: tuple[Body, ...]
    position: Position = field(default=NOWHERE, compare=False, repr=False)


BodyFormula: TypeAlias = Step | If | While | For | Fork


@dataclass(frozen=True, slots=True)
class Body:
    """The formulas of a plan, block or bracketed sequence, in order; may be empty."""

    formulas: tuple[BodyFormula, ...] = ()
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Trigger:
    """``+!g(X)[source(S)]``: ``operator`` is ``+ - ^``, ``goal`` is ``""`` (belief), ``"!"`` or ``"?"``."""

    operator: str
    goal: str
    literal: Structure | Variable
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Plan:
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
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Belief:
    """An initial belief, ``p(1)[a].``; its arguments may be arithmetic."""

    literal: Structure
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Rule:
    """``head :- body.``"""

    head: Structure
    body: Formula
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Goal:
    """An initial goal, ``!g.`` (or ``?g.`` with ``operator="?"``)."""

    literal: Structure
    operator: str = "!"
    position: Position = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Directive:
    """``{ include("f.asl", n) }``, or with ``items`` (not None) a block ``{ begin namespace(n) } ... { end }``.

    ``name`` is the directive with its arguments: ``Structure("include", (String("f.asl"), Structure("n")))``.
    """

    name: Structure
    items: tuple[Item, ...] | None = None
    position: Position = field(default=NOWHERE, compare=False, repr=False)


Item: TypeAlias = Belief | Rule | Goal | Plan | Directive


@dataclass(frozen=True, slots=True)
class Program:
    """A source file: its items in file order, and the warnings of the parser (deviation D1 and the like).

    ``scoped``: it may name a namespace; ``this_ns``: it may contain the atom of that name.
    """

    file: str
    items: tuple[Item, ...] = ()
    warnings: tuple[Finding, ...] = ()
    scoped: bool = field(default=False, compare=False)
    this_ns: bool = field(default=False, compare=False)

    def plans(self) -> Iterator[Plan]:
        """All plans, also those in blocks, in file order; sub-plans stay inside their plan."""
        yield from (item for item in _flat(self.items) if isinstance(item, Plan))


def _flat(items: tuple[Item, ...]) -> Iterator[Item]:
    for item in items:
        yield item
        if isinstance(item, Directive) and item.items:
            yield from _flat(item.items)
