"""The plan library of a mind: its plans by trigger, loaded when first used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from agentd.language.compiler.code_writer import FRAME_HEADER, PlanCode, Ref
from agentd.language.compiler.constants import signature_of
from agentd.language.compiler.units import Form, compile_fragment, compile_plan
from agentd.language.syntax_tree import nodes as syntax
from agentd.language.syntax_tree.signatures import DEFAULT, Signature, signature
from agentd.language.syntax_tree.traversal import walk
from agentd.language.terms.format import code_text
from agentd.language.terms.from_ast import Instantiation
from agentd.language.terms.source_annotations import SOURCE_SELF
from agentd.language.terms.terms import Code, Literal, Term, atom
from agentd.mind.beliefs.unification import Trail
from agentd.mind.data.intention import Event, Frame, Step
from agentd.mind.data.registry import Library

if TYPE_CHECKING:
    from agentd.mind.state import MindState

Select: TypeAlias = "Callable[[MindState, Trail, Event], Frame | None]"
"""Finds the plan for an event: returns the new frame with its bindings on the trail, or None."""


_ASKING: Final = frozenset({".intention", ".current_intention"})
_ATOMIC = signature("atomic")
_NEVER = object()
GENERATED: Final = "p__"
"""How the labels begin that plans without one are given."""


class Relevant:
    """The plans for one trigger: operator, kind of goal and signature. Plans with a variable trigger are among them."""

    __slots__ = ("_library", "_others", "call", "goal", "operator", "plans", "sig", "tail")

    def __init__(self, library: PlanLibrary, operator: str, goal: str, sig: Signature) -> None:
        self.operator, self.goal, self.sig = operator, goal, sig
        self.plans: list[Plan] = []
        self.tail: Signature | None = sig if goal == "!" else None
        self.call: object = sig if goal == "!" else _NEVER
        """A plan has nothing left to do but to wait for the goal that it called last where its own ``tail`` is the
        ``call`` of that goal: the same kind of goal. Then its frame is dropped, so that such recursion needs no memory.
        """
        self._library = library
        self._others: dict[str, Relevant] = {}

    def counterpart(self, operator: str) -> Relevant:
        """Return the plans for the same literal with another operator: ``-!g`` for ``+!g``."""
        found = self._others.get(operator)
        if found is None:
            found = self._others[operator] = self._library.relevant(operator, self.goal, self.sig)
        return found

    @property
    def text(self) -> str:
        """Operator and kind of goal: ``+!``."""
        return f"{self.operator}{self.goal}"

    def __repr__(self) -> str:
        return f"{self.operator}{self.goal}{self.sig.indicator}"


class Plan:
    """A plan of a mind. Its code is generated and loaded when it is first tried."""

    __slots__ = (
        "_library",
        "_size",
        "around",
        "atomic",
        "bound",
        "condition",
        "file",
        "label",
        "on_failure",
        "options",
        "outer",
        "select",
        "shown",
        "slots",
        "sources",
        "special",
        "steps",
        "subplans",
        "syntax",
        "trace",
        "tried",
        "tried_texts",
        "values",
    )

    def __init__(self, library: PlanLibrary, node: syntax.Plan, label: Literal, values: dict[str, Any]) -> None:
        self._library, self.syntax, self.label, self.values = library, node, label, values
        self.atomic = any(type(a) is Literal and a.sig is _ATOMIC for a in label.annots)
        self.special = self.atomic or node.goal_condition is not None or bool(node.subplans)
        """Whether entering and leaving it takes more than a frame."""
        self.slots: dict[str, int] = {}
        self.around: dict[str, int] = {}
        self.subplans = [Plan(library, inner, atom("inner"), values) for inner in node.subplans]
        self.outer: Plan | None = None
        for inner in self.subplans:
            inner.outer = self
        self.on_failure: Any = None
        """Called with a failure that no plan above this one handles; only plans of the mind's own have it."""
        self.condition: Any = None
        """For ``<:``, the function that asks whether the goal's condition holds, once loaded."""
        self.sources: list[Term] = [SOURCE_SELF.args[0]]
        """The sources of the plan: the agent itself, or senders of ``tellHow``."""
        self.file = ""
        """The file that holds it; empty for a plan that was added as a term or text."""
        self.tried: list[tuple[Any, tuple[str, ...]]] = []
        """The literals of the context in order, as `trace` numbers them, with their variables that have values then."""
        self.tried_texts: dict[int, str] = {}
        """The same as text, made on demand."""
        self.bound: tuple[str, ...] = ()
        """The variables that have a place filled when the plan is selected."""
        self.steps: list[Step | None] = []
        """The formulas of its body, once loaded."""
        self.shown: tuple[str, str, str] | None = None
        """Its label, trigger and position as text, made on demand."""
        self._size = FRAME_HEADER
        self.unload()

    def unload(self) -> None:
        """Drop the code: it is generated again, in the form then needed, when the plan is next tried."""
        self.select: Any = partial(self._first, "select")
        """A new frame for an event, or None: see `agentd.language.compiler.units` for this and the others."""
        self.trace: Any = partial(self._first, "trace")
        self.options: Any = partial(self._first, "options")
        for inner in self.subplans:
            inner.unload()

    def _first(self, form: Form, *event: Any) -> Any:
        """Load the code, and select by the function of a form."""
        self.load()
        return getattr(self, form)(*event)

    def load(self) -> None:
        """Generate the code and put it in place."""
        library = self._library
        form = library.compiler.form
        code = compile_plan(self.syntax, library.compiler, self.values, self.around, form)
        self.slots, self._size, self.tried, self.bound = code.slots, code.size, code.tried, tuple(code.bound)
        self.tried_texts.clear()
        namespace, self.steps = self._load(code)
        if form == "select":
            self.select = namespace["select"]
        else:
            options: Any = namespace.get("options")
            self.options = options
            self.trace = trace = namespace.get("trace") or (lambda *event: next(options(*event)))
            self.select = lambda *event: found if type(found := trace(*event)) is list else None
        self.condition = namespace.get("condition")
        for inner in self.subplans:
            inner.around = {**self.around, **self.slots}

    def tracing(self) -> Any:
        """Return the form of `select` that returns the reason if it selects nothing."""
        if self._library.compiler.form != "select":
            return self.trace
        if isinstance(self.trace, partial):
            code = compile_plan(self.syntax, self._library.compiler, self.values, self.around, "trace")
            self.tried = code.tried
            self.trace = self._load(code)[0]["trace"]
        return self.trace

    def fragment(self, body: syntax.Body, values: dict[str, Any], following: Step | None) -> Step | None:
        """Return the first step of a body held by a variable, to run in this plan's frame before ``following``."""
        code = compile_fragment(body, self._library.compiler, values, self.slots, self._size)
        self.slots, self._size = code.slots, code.size
        _, steps = self._load(code, following)
        return None if code.first is None else steps[code.first]

    def _load(self, code: PlanCode, following: Step | None = None) -> tuple[dict[str, Any], list[Any]]:
        steps: list[Any] = [Step(s.syntax, self) if s.function else following for s in code.steps]
        first = None if code.first is None else steps[code.first]
        library = self._library

        def provide(ref: Ref) -> Any:
            match ref.kind:
                case "step":
                    found: Step | None = steps[ref.what]
                    return found
                case "first":
                    return first
                case "plan":
                    return self
            return library.provide(ref)

        namespace = code.unit.load(library.runtime, provide)
        for step, written in zip(steps, code.steps, strict=True):
            if not written.function:
                continue
            step.run = namespace[written.function]
            step.next = None if written.next is None else steps[written.next]
        return namespace, steps

    @property
    def size(self) -> int:
        """The number of places in its frame."""
        return self._size

    @property
    def head(self) -> str:
        """The trigger as written."""
        return code_text(Code(self.syntax.trigger, bare=True))


def _only_for(trigger: syntax.Trigger) -> tuple[str, str, Signature] | None:
    """Return the events that a trigger is for, as `Relevant` names them; None if they are of several signatures."""
    literal = trigger.literal
    if not isinstance(literal, syntax.Structure) or isinstance(literal.namespace, syntax.Variable):
        return None
    return trigger.operator, trigger.goal, signature_of(literal)


class PlanLibrary:
    """All plans of a mind, in order."""

    def __init__(
        self,
        compiler: Library,
        runtime: dict[str, Any],
        predicate: Callable[[Signature], Any],
        select: Select,
        by_rule: Select,
    ) -> None:
        """``select`` finds plans where some are nested or contexts ask for the intention in hand.

        ``by_rule`` finds them in programs with rules ``select__option``.
        """
        self.compiler, self.runtime = compiler, runtime
        self._predicate = predicate
        self.plans: list[Plan] = []
        self._relevant: dict[tuple[str, str, Signature], Relevant] = {}
        self.version = 0
        """Grows whenever a plan, or the source of one, is added or removed."""
        self._labels = 0
        self.select: Select | None = None
        """Finds the plan for an event; None: the relevant ones are tried in order."""
        self.select_slowly, self._by_rule = select, by_rule
        self._scoped: Callable[..., Frame | None] | None = None
        self.taken: Event | None = None
        """The event that is being given a plan, where contexts ask for it (`agentd.mind.plans.nested_plans`)."""
        self.has_meta = False
        self.has_nested = False
        self.sleeps = False
        """Whether there are plans for the agent's sleep (`agentd.mind.mind`)."""
        self.kqml = self.relevant("+", "!", signature("kqml_received", 4))
        """The program's own plans for messages."""

    def provide(self, ref: Ref) -> Any:
        """Return the plans of a trigger, or the predicate of a signature, for generated code."""
        return self.relevant(*ref.what) if ref.kind == "relevant" else self._predicate(ref.what)

    def relevant(self, operator: str, goal: str, sig: Signature) -> Relevant:
        """Return the plans for a trigger; the same object each time."""
        key = (operator, goal, sig)
        found = self._relevant.get(key)
        if found is None:
            found = self._relevant[key] = Relevant(self, operator, goal, sig)
            found.plans.extend(p for p in self.plans if self.answers(p, found))
        return found

    @staticmethod
    def answers(plan: Plan, relevant: Relevant) -> bool:
        """Return whether a plan's trigger is of this kind."""
        trigger = plan.syntax.trigger
        if trigger.operator != relevant.operator or trigger.goal != relevant.goal:
            return False
        literal = trigger.literal
        if isinstance(literal, syntax.Structure):
            sig, asked = signature_of(literal), relevant.sig
            if isinstance(literal.namespace, syntax.Variable):
                return (sig.functor, sig.arity, sig.negated) == (asked.functor, asked.arity, asked.negated)
            return sig is asked
        namespace = literal.namespace if isinstance(literal.namespace, str) else DEFAULT
        return namespace == relevant.sig.namespace and literal.negated <= relevant.sig.negated

    def make(self, node: syntax.Plan, values: dict[str, Any] | None = None) -> Plan:
        """Return a plan that is not yet in the library."""
        return Plan(self, node, self._label(node), values or {})

    def make_of_file(self, node: syntax.Plan) -> Plan:
        """`make` for a plan of a file."""
        plan = self.make(node)
        plan.file = node.position.file
        return plan

    def _label(self, node: syntax.Plan) -> Literal:
        if isinstance(node.label, syntax.Structure) and node.label.functor:
            made = Instantiation({}, {}).term(node.label)
            assert isinstance(made, Literal)
            self._note_label(made)
            return made
        self._labels += 1
        annots = (
            Instantiation({}, {}).annots(node.label.annotations) if isinstance(node.label, syntax.Structure) else ()
        )
        return Literal(signature(f"{GENERATED}{self._labels}"), (), annots)

    def _note_label(self, label: Literal) -> None:
        number = label.sig.functor.removeprefix(GENERATED)
        if number != label.sig.functor and number.isdecimal():
            self._labels = max(self._labels, int(number))

    def name(self, plan: Plan, label: Literal) -> None:
        """Give a plan the label that it had before."""
        plan.label = label
        self._note_label(label)

    def add(self, plan: Plan, first: bool = False) -> None:
        """Put a plan at the end of the library, or before all others."""
        self.version += 1
        self.plans.insert(0 if first else len(self.plans), plan)
        self._note(plan)
        key = _only_for(plan.syntax.trigger)
        if key is not None:
            self.relevant(*key)
        for relevant in self._relevant.values():
            if plan not in relevant.plans and self.answers(plan, relevant):
                relevant.plans.insert(0 if first else len(relevant.plans), plan)

    def extend(self, nodes: list[syntax.Plan]) -> None:
        """Add the plans of a program together."""
        self.version += 1
        for node in nodes:
            plan = self.make_of_file(node)
            self.plans.append(plan)
            self._note(plan)
            key = _only_for(node.trigger)
            if key is not None and key not in self._relevant:
                self._relevant[key] = Relevant(self, *key)
        for relevant in self._relevant.values():
            relevant.plans.clear()
        wild = []
        for plan in self.plans:
            key = _only_for(plan.syntax.trigger)
            if key is None:
                wild.append(plan)
            else:
                self._relevant[key].plans.append(plan)
        if wild:
            order = {plan: n for n, plan in enumerate(self.plans)}
            for relevant in self._relevant.values():
                relevant.plans.extend(p for p in wild if self.answers(p, relevant))
                relevant.plans.sort(key=lambda p: order[p])

    def _note(self, plan: Plan) -> None:
        """Remember what kinds of plans there are, so that only programs that use them pay for them."""
        if plan.syntax.trigger.operator == "^":
            self.has_meta = self.compiler.has_meta = True
        self.sleeps = self.sleeps or _is_about_sleep(plan.syntax.trigger)
        if plan.subplans:
            self.has_nested = True
            self._select_slowly()
        if plan.syntax.context is not None:
            self.note_formula(plan.syntax.context)

    def note_formula(self, formula: syntax.Term) -> None:
        """Remember that a context, or a rule that contexts may use, asks for the intention in hand."""
        if any(isinstance(node, syntax.InternalAction) and node.name in _ASKING for node in walk(formula)):
            self._select_slowly()

    def choose_by_rule(self) -> None:
        """Choose among options by the program's rules ``select__option``, unless a selection function does."""
        if self.compiler.form != "options":
            self.choose_options(self._by_rule)

    def choose_options(self, select: Select) -> None:
        """Find plans by a function that chooses among all options from now on."""
        self.compiler.form, self.select_slowly = "options", select
        self._select_slowly()
        for plan in self.plans:
            plan.unload()

    def _select_slowly(self) -> None:
        """Find the plans for events by the function ``select_slowly`` from now on."""
        found = self.select_slowly
        self.select = found if self._scoped is None else partial(self._scoped, found)

    def select_within(self, scoped: Callable[..., Frame | None]) -> None:
        """From now on let ``scoped`` call the function that finds plans; it gets that and then its arguments."""
        self._scoped = scoped
        self._select_slowly()

    def remove(self, plan: Plan) -> None:
        """Take a plan out; instances of it that run go on."""
        self.version += 1
        self.plans.remove(plan)
        for relevant in self._relevant.values():
            if plan in relevant.plans:
                relevant.plans.remove(plan)

    def __iter__(self) -> Iterator[Plan]:
        return iter(self.plans)


def _is_about_sleep(trigger: syntax.Trigger) -> bool:
    """Return whether a plan's trigger is for the events of an agent's sleep (`agentd.mind.mind`)."""
    literal = trigger.literal
    return (
        isinstance(literal, syntax.Structure)
        and literal.functor in ("jag_sleeping", "jag_awaking")
        and not literal.args
    )
