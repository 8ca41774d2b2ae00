"""A mind: the state of one agent with its program. The runtime feeds and runs it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import UTC, tzinfo
from random import Random
from typing import TYPE_CHECKING, Any, Final

from agentd.language.compiler.compile import CompiledProgram
from agentd.language.compiler.units import compile_formula
from agentd.language.terms import order, source_annotations, terms
from agentd.mind.beliefs import dynamic_formulas, term_copy, unification, work_limit
from agentd.mind.beliefs.belief_base import BeliefBase
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data import formula_failure
from agentd.mind.data.effects import Effect, Log
from agentd.mind.data.inputs import Input, SignalRaised, TooDeep
from agentd.mind.data.registry import Library
from agentd.mind.execution import belief_updates, control_flow, goal_execution, goal_states, waiting
from agentd.mind.execution.cycle import run_cycles
from agentd.mind.execution.dropping import fail_too_deep
from agentd.mind.execution.option_selection import RULE, Chooser, Selector, by_function, by_rule, selectors_of
from agentd.mind.execution.program_loading import copy_mind, load_program
from agentd.mind.introspection import snapshots
from agentd.mind.introspection.decision_log import Decisions, record_of
from agentd.mind.introspection.decision_views import Views, view_of
from agentd.mind.introspection.snapshots import belief_views, intention_views
from agentd.mind.plans import plan_terms
from agentd.mind.plans.nested_plans import select
from agentd.mind.plans.plan_library import PlanLibrary
from agentd.mind.state import MindState
from schemas.wire.mind_records import BeliefView, DecisionView, FailureView, IntentionView

if TYPE_CHECKING:
    from agentd.mind.persistence.change_tracking import Keeper

MOST_FRAMES: Final = 300_000
"""Plans that an intention may be in the middle of; a goal that calls itself without end fails beyond."""


_NAMES: Final = {
    terms: "EMPTY FALSE TRUE Expression List Literal Open Rest Var atom deref elements make_list",
    source_annotations: "SELF",
    order: "sorted_annots",
    dynamic_formulas: "arithmetic call order same solve univ",
    term_copy: "annots_with_tail detach is_ground resolve resolve_annots with_source",
    unification: "bound_again in_default open_bare open_list open_structure subsets undo unify value",
    work_limit: "distinct ordered too_much_work",
    plan_terms: "capture",
    formula_failure: "action_said_no constraint_failed test_failed",
    belief_updates: "believe believed change_term disbelieve replace",
    control_flow: "begin_rounds fork free_again join next_round present",
    goal_execution: "achieve_term perform qualify run_term test_event test_term",
    goal_states: "pending",
    snapshots: "held",
    waiting: "wait_until",
}
"""The modules that generated code may use, and what of them."""
RUNTIME: Final[dict[str, Any]] = {
    name: getattr(module, name) for module, names in _NAMES.items() for name in names.split()
}
"""The names that generated code may use besides its constants."""

_SLEEPING: Final = SignalRaised.named("jag_sleeping")
_AWAKING: Final = SignalRaised.named("jag_awaking")


def wake_up(mind: MindState) -> None:
    """Before cycles: end the sleep if there is an input, a message or a due timer. Its event is the first."""
    inputs, heap = mind.inputs, mind.timers.heap
    announced = bool(inputs) and inputs[0] is _SLEEPING
    if mind.asleep and (len(inputs) > announced or mind.mailbox or (heap and heap[0].due <= mind.now)):
        mind.asleep = False
        inputs.insert(int(announced), _AWAKING)


def fall_asleep(mind: MindState) -> None:
    """After cycles without effect: begin a sleep if nothing is left to do but to wait. Once until it ends."""
    if mind.asleep is not False or mind.atomic is not None:
        return
    mind.asleep = True
    if mind.ready:
        mind.asleep = False
    else:
        mind.inputs.append(_SLEEPING)


class Mind(MindState):
    """One agent's beliefs, plans, intentions and cycle. Everything from outside is fed in.

    ``seed`` starts its random numbers; ``start`` is the mission time in seconds at its beginning. ``actions`` are the
    names of the external actions that can be performed, None for any; ``names_variables``: actions may contain
    variables without a value, as in the paper's ``arm_motors(True)``. ``clock`` gives the mission time when the program
    asks for it within a cycle; each reading is an input (`TimeRead`). Without a clock, time does not advance within a
    call of `step`. ``on_input`` is called with each input and the number of the cycle that takes it: fed again in the
    same cycles, the inputs lead to the same effects. ``agents`` returns the names of possible receivers; None: no
    receiver is checked. ``has_team``: each `TeamRequest` is answered. ``ask_timeout`` in seconds bounds synchronous
    asks without a limit of their own. ``epoch`` is the Unix time of mission time 0 and ``zone`` its time zone, for
    ``.date`` and ``.time``. ``decisions`` is the number of decisions and failures to remember (`decision_views`); 0
    costs nothing. ``on_decision`` is called with each of them as it is made. ``select_message``, ``select_event``,
    ``select_option`` and ``select_intention`` choose in place of the defaults; a subclass may have methods of these
    names instead (`agentd.mind.execution.option_selection`). ``keeper`` notes changes, so that the mind can be saved
    and restored (`agentd.mind.persistence.change_tracking`).
    """

    __slots__ = ("_queries", "program")

    recorder: Decisions | None

    def __init__(
        self,
        name: str,
        program: CompiledProgram,
        *,
        seed: int = 0,
        start: float = 0.0,
        actions: Iterable[str] | None = None,
        names_variables: bool = False,
        clock: Callable[[], float] | None = None,
        on_input: Callable[[int, Input], None] | None = None,
        agents: Callable[[], Iterable[str]] | None = None,
        has_team: bool = False,
        ask_timeout: float | None = None,
        epoch: float = 0.0,
        zone: tzinfo = UTC,
        decisions: int = 0,
        on_decision: Callable[[DecisionView | FailureView], None] | None = None,
        select_message: Selector | None = None,
        select_event: Selector | None = None,
        select_option: Selector | None = None,
        select_intention: Selector | None = None,
        keeper: Keeper | None = None,
    ) -> None:
        compiler = Library()
        beliefs = (BeliefBase if keeper is None else keeper.belief_base)(self.begin_scopes)
        MindState.__init__(
            self,
            name=name,
            beliefs=beliefs,
            compiler=compiler,
            plans=PlanLibrary(compiler, RUNTIME, beliefs.predicate, select, by_rule),
            random=Random(seed),
            start=start,
            now=start,
            most_frames=MOST_FRAMES,
            actions=None if actions is None else frozenset(actions),
            names_variables=names_variables,
            has_team=has_team,
            ask_timeout=ask_timeout,
            epoch=epoch,
            zone=zone,
            clock=clock,
            agents=agents,
            on_input=on_input,
        )
        self.program = program
        self._queries: dict[int, tuple[Any, Any]] = {}
        if decisions or on_decision is not None:
            tell = None if on_decision is None else (lambda record: on_decision(view_of(self, record)))
            self.recorder = Decisions(self, max(1, decisions), tell)
        selectors = selectors_of(self, (select_message, select_event, select_option, select_intention))
        if "select_option" in selectors:
            self.plans.choose_options(by_function(selectors.pop("select_option")))
        if selectors:
            self.turns = Chooser(self, selectors)
        if keeper is None:
            load_program(self, program)
        else:
            keeper.begin(self, program)
        if self.beliefs.known(RULE) is not None:
            self.plans.choose_by_rule()

    def copy_from(self, other: Mind) -> None:
        """Take over another mind's beliefs, rules and plans, without their events (``.clone``)."""
        copy_mind(self, other)

    def step(self, now: float) -> list[Effect]:
        """Run one reasoning cycle at mission time ``now`` in seconds and return its effects, in order."""
        return self.run(now, 1)

    def run(self, now: float, cycles: int) -> list[Effect]:
        """Run at most ``cycles`` cycles at mission time ``now`` in seconds; a smaller one than before is not taken.

        Stop early when there is an effect or nothing left to do.
        """
        if now > self.now:
            self.now = now
        sleeps = self.plans.sleeps
        if sleeps:
            wake_up(self)
        try:
            run_cycles(self, cycles)
        except RecursionError:
            self.effects.append(Log("error", "a term or rule is too deep; what it was needed for is lost"))
        current = self.current
        if current is not None and len(current.stack) > self.most_frames:
            if self.on_input is not None:
                self.on_input(self.cycle, TooDeep())
            fail_too_deep(self, current)
        effects, self.effects = self.effects, []
        if sleeps and not effects:
            fall_asleep(self)
        return effects

    @property
    def wake_at(self) -> float | None:
        """The earliest mission time at which something is due that no input announces; None if there is none."""
        return self.timers.next_due()

    @property
    def idle(self) -> bool:
        """Nothing to do, nothing due and nothing waited for: only an input can wake this mind."""
        return not self.ready and self.wake_at is None and not self.waiting

    def query(self, formula: Any) -> bool:
        """Return whether a parsed formula (`agentd.language.parse.parse_formula`) follows from the beliefs.

        It leaves no trace in the mind, whatever rules it uses.
        """
        known = self._queries.get(id(formula))
        if known is None:
            holds = compile_formula(formula, self.compiler).load(RUNTIME, self.plans.provide)["holds"]
            known = self._queries[id(formula)] = (holds, formula)
        trail: list[Any] = []
        self.steps_left = MOST_STEPS
        own = self.random, self.on_input, self.effects, self.now, self.warned
        self.random, self.on_input, self.effects, self.warned = Random(self.cycle), None, [], {}
        try:
            return bool(known[0](self, trail))
        except Exception:  # a function of the program's may raise anything: what cannot be computed does not hold
            return False
        finally:
            unification.undo(trail, 0)
            self.random, self.on_input, self.effects, self.now, self.warned = own

    def intention_views(self, most: int | None = None) -> list[IntentionView]:
        """Return the present intentions by their ids, at most ``most`` (None: all)."""
        return intention_views(self, most)

    def belief_views(self) -> list[BeliefView]:
        """Return the present beliefs."""
        return belief_views(self)

    def decision_views(self, last: int | None = None) -> list[DecisionView | FailureView]:
        """Return the ``last`` decisions and failures (None: all), oldest first; none unless it remembers any."""
        if self.recorder is None:
            return []
        records = list(map(record_of, self.recorder.entries()))
        return list(map(Views(self, records).of, records if last is None else records[max(0, len(records) - last) :]))
