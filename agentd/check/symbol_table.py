"""Symbols of a program by kind: goals, beliefs, actions, internal actions, plans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from agentd.language.syntax_tree.nodes import (
    Belief,
    Body,
    BodyFormula,
    Directive,
    For,
    Fork,
    If,
    InternalAction,
    ListTerm,
    Plan,
    Position,
    Rule,
    Step,
    Structure,
    While,
)
from agentd.language.syntax_tree.signatures import DEFAULT, THIS_NS

ANY_ARITY = -1
"""The arity of a registered function that takes any number of arguments."""


@dataclass(frozen=True, slots=True)
class Mention:
    """A literal in its place. ``name`` is qualified (``ns::b``) outside the default namespace.

    ``inverted``: under an odd number of ``not``. ``from_others``: asks for a source that is neither self nor percept.
    """

    name: str
    literal: Structure
    inverted: bool = False
    from_others: bool = False

    @property
    def arity(self) -> int:
        return len(self.literal.args)

    @property
    def position(self) -> Position:
        return self.literal.position

    @property
    def indicator(self) -> tuple[str, int]:
        return self.name, self.arity


@dataclass(frozen=True, slots=True)
class Call:
    """An internal action or function in its place; ``as_term``: as a value and not as a step or condition."""

    action: InternalAction
    as_term: bool


@dataclass(frozen=True, slots=True)
class PlacedPlan:
    """A plan with the qualified name of its trigger; None when that is a variable."""

    plan: Plan
    name: str | None

    @property
    def arity(self) -> int:
        literal = self.plan.trigger.literal
        return len(literal.args) if isinstance(literal, Structure) else 0

    @property
    def event(self) -> str:
        """``+!``, ``-``, ``+?`` and so on."""
        return self.plan.trigger.operator + self.plan.trigger.goal

    @property
    def is_test(self) -> bool:
        """Whether `agentd test` runs the plan: its label has the annotation ``test``."""
        return self.is_labelled("test")

    def is_labelled(self, word: str) -> bool:
        """Whether the plan's label has an annotation."""
        annotations = self.plan.label.annotations if self.plan.label is not None else None
        items = annotations.items if annotations is not None else ()
        return any(isinstance(item, Structure) and item.functor == word for item in items)

    @property
    def names_source(self) -> bool:
        """Whether the trigger names the source of its event: ``+!g[source(S)]``."""
        annotations = self.plan.trigger.literal.annotations
        items = annotations.items if annotations is not None else ()
        return any(isinstance(item, Structure) and item.functor == "source" for item in items)

    @property
    def indicator(self) -> tuple[str | None, int]:
        return self.name, self.arity


@dataclass(slots=True)
class Survey:
    """Everything that a program mentions, in no particular order.

    ``families`` are plans that are tried together: those of a program, those nested in one plan. ``open_beliefs``,
    ``open_plans`` and ``open_goals``: the program makes some at run time which no survey can see.
    """

    achieved: list[Mention] = field(default_factory=list)
    """Goals that the program sets itself."""
    tested: list[Mention] = field(default_factory=list)
    asked: list[Mention] = field(default_factory=list)
    """Tests by ``?``, for which a plan may answer."""
    added: list[Mention] = field(default_factory=list)
    raised: list[Mention] = field(default_factory=list)
    """The literals of triggers that are terms: ``.at("now +1 s", {+!g})`` raises such an event."""
    sent: list[Mention] = field(default_factory=list)
    """Beliefs that are sent to agents."""
    wanted: list[Mention] = field(default_factory=list)
    """Goals and questions that are sent to agents."""
    actions: list[Mention] = field(default_factory=list)
    calls: list[Call] = field(default_factory=list)
    plans: list[PlacedPlan] = field(default_factory=list)
    families: list[list[PlacedPlan]] = field(default_factory=list)
    rules: list[Rule] = field(default_factory=list)
    beliefs: list[Belief] = field(default_factory=list)
    directives: list[Directive] = field(default_factory=list)
    bodies: list[Body] = field(default_factory=list)
    functions: set[tuple[str, int]] = field(default_factory=set)
    open_beliefs: bool = False
    open_plans: bool = False
    open_goals: bool = False
    open_sent: bool = False
    """Beliefs are sent that only the run knows."""
    late_files: list[InternalAction] = field(default_factory=list)
    """Calls of `.include` and `.create_agent` that name their file by what only the run knows."""
    created: list[tuple[str, Position]] = field(default_factory=list)
    """The files of the agents that it creates, where it writes their names out."""
    teaches: bool = False
    """Plans are sent to agents."""
    looks_at_plans: bool = False
    """The program takes its plans for data, or removes some."""
    ends_goals: bool = False
    """The program may end or suspend goals of its own while they are pursued."""
    ends_others: bool = False
    """It may end other agents, or goals of theirs."""
    open_wanted: bool = False
    """Goals are sent that only the run knows."""


def steps_of(body: Body) -> Iterator[Step]:
    """The steps of a body, those in its blocks included."""
    pending: list[BodyFormula] = list(body.formulas)
    while pending:
        match pending.pop():
            case Step() as step:
                yield step
            case If(branches, otherwise):
                pending += [formula for _, block in branches for formula in block.formulas]
                pending += otherwise.formulas if otherwise is not None else ()
            case While(_, block) | For(_, block):
                pending += block.formulas
            case Fork(branches=blocks):
                pending += [formula for block in blocks for formula in block.formulas]


_NEARBY = frozenset(("self", "percept"))


def qualified(literal: Structure, namespace: str) -> str:
    """The name of a literal in a namespace: with its sign, and with the namespace unless it is the default one."""
    written = literal.namespace
    if isinstance(written, str) and written != THIS_NS:
        namespace = written or DEFAULT
    name = f"~{literal.functor}" if literal.negated else literal.functor
    return name if namespace == DEFAULT else f"{namespace}::{name}"


def asks_others(annotations: ListTerm) -> bool:
    """Whether annotations ask for a source that is neither the agent itself nor its percepts."""
    for term in annotations.items:
        match term:
            case Structure("source", (Structure(functor),)):
                return functor not in _NEARBY
            case Structure("source", _):
                return True
    return False
