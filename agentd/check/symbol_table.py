"""Symbols of a program by kind: goals, beliefs, actions, internal actions, plans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT, THIS_NS
from agentd.language.syntax_tree.traversal import is_annotated

ANY_ARITY = -1
"""The arity of a registered function that takes any number of arguments."""


@dataclass(frozen=True, slots=True)
class Mention:
    """A literal in its place. ``name`` is qualified (``ns::b``) outside the default namespace.

    ``inverted``: under an odd number of ``not``. ``from_others``: asks for a source that is neither self nor percept.
    """

    name: str
    literal: nodes.Structure
    inverted: bool = False
    from_others: bool = False

    @property
    def arity(self) -> int:
        """The number of arguments."""
        return len(self.literal.args)

    @property
    def position(self) -> nodes.Position:
        """The place of the trigger's literal."""
        return self.literal.position

    @property
    def indicator(self) -> tuple[str, int]:
        """Name and number of arguments."""
        return self.name, self.arity


@dataclass(frozen=True, slots=True)
class Call:
    """An internal action or function in its place; ``as_term``: as a value and not as a step or condition."""

    action: nodes.InternalAction
    as_term: bool


@dataclass(frozen=True, slots=True)
class PlacedPlan:
    """A plan with the qualified name of its trigger; None when that is a variable."""

    plan: nodes.Plan
    name: str | None

    @property
    def arity(self) -> int:
        """The number of arguments."""
        literal = self.plan.trigger.literal
        return len(literal.args) if isinstance(literal, nodes.Structure) else 0

    @property
    def event(self) -> str:
        """``+!``, ``-``, ``+?`` and so on."""
        return self.plan.trigger.operator + self.plan.trigger.goal

    @property
    def names_source(self) -> bool:
        """Whether the trigger names the source of its event: ``+!g[source(S)]``."""
        return is_annotated(self.plan.trigger.literal, "source")

    @property
    def indicator(self) -> tuple[str | None, int]:
        """Name and number of arguments."""
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
    rules: list[nodes.Rule] = field(default_factory=list)
    beliefs: list[nodes.Belief] = field(default_factory=list)
    directives: list[nodes.Directive] = field(default_factory=list)
    bodies: list[nodes.Body] = field(default_factory=list)
    functions: set[tuple[str, int]] = field(default_factory=set)
    open_beliefs: bool = False
    open_plans: bool = False
    open_goals: bool = False
    open_sent: bool = False
    """Beliefs are sent that only the run knows."""
    late_files: list[nodes.InternalAction] = field(default_factory=list)
    """Calls of `.include` and `.create_agent` that name their file by what only the run knows."""
    created: list[tuple[str, nodes.Position]] = field(default_factory=list)
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

    def in_families(self) -> Iterator[PlacedPlan]:
        """Return the plans of the program and those nested in them, without those that are terms."""
        return chain.from_iterable(self.families)


def takes_all(plan: nodes.Plan) -> bool:
    """Return whether a plan is relevant and applicable for every event of its name and arity."""
    literal = plan.trigger.literal
    if not isinstance(literal, nodes.Structure) or literal.annotations or isinstance(literal.namespace, nodes.Variable):
        return False
    names = [arg.name for arg in literal.args if isinstance(arg, nodes.Variable) and arg == nodes.Variable(arg.name)]
    named = [name for name in names if not name.startswith("_")]
    return plan.context is None and len(names) == len(literal.args) and len(set(named)) == len(named)


def steps_of(body: nodes.Body) -> Iterator[nodes.Step]:
    """Yield the steps of a body, those in its blocks included."""
    pending: list[nodes.BodyFormula] = list(body.formulas)
    while pending:
        match pending.pop():
            case nodes.Step() as step:
                yield step
            case nodes.If(branches, otherwise):
                pending += [formula for _, block in branches for formula in block.formulas]
                pending += otherwise.formulas if otherwise is not None else ()
            case nodes.While(_, block) | nodes.For(_, block):
                pending += block.formulas
            case nodes.Fork(branches=blocks):
                pending += [formula for block in blocks for formula in block.formulas]


def qualified(literal: nodes.Structure, namespace: str) -> str:
    """Return the name of a literal in a namespace: with its sign, and the namespace unless it is the default one."""
    written = literal.namespace
    if isinstance(written, str) and written != THIS_NS:
        namespace = written or DEFAULT
    name = f"~{literal.functor}" if literal.negated else literal.functor
    return name if namespace == DEFAULT else f"{namespace}::{name}"


def asks_others(annotations: nodes.ListTerm) -> bool:
    """Return whether annotations ask for a source that is neither the agent itself nor its percepts."""
    for term in annotations.items:
        match term:
            case nodes.Structure("source", (nodes.Structure(functor),)):
                return functor not in ("self", "percept")
            case nodes.Structure("source", _):
                return True
    return False
