"""A mind: the state of one agent, what goes into it and comes out, and what others may ask. `cycle` moves it."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterable
from datetime import UTC, tzinfo
from typing import Any, Final

from agentd.language.compiler.code_writer import Ref
from agentd.language.compiler.compile import CompiledProgram
from agentd.language.compiler.plan import compile_formula
from agentd.language.syntax_tree.signatures import Signature
from agentd.language.terms.source_annotations import told_by_others
from agentd.language.terms.terms import Literal
from agentd.mind.beliefs.annotations import with_source
from agentd.mind.beliefs.belief_base import BeliefBase
from agentd.mind.beliefs.open_beliefs import OpenBeliefs
from agentd.mind.beliefs.term_copy import detach, resolve_all, resolve_annots
from agentd.mind.beliefs.unification import undo
from agentd.mind.beliefs.work_limit import MOST_STEPS
from agentd.mind.data.effects import Effect, Log, SendMail
from agentd.mind.data.frames import PLAN, Frame
from agentd.mind.data.inputs import Input, Mail, TimeRead, TooDeep
from agentd.mind.data.intention import Event, Intention
from agentd.mind.data.timers import Timer, Timers
from agentd.mind.execution.belief_updates import believe
from agentd.mind.execution.cycle import atomic_can_run, run_cycles
from agentd.mind.execution.dropping import fail_too_deep
from agentd.mind.execution.event_selection import take_event, take_event_recorded
from agentd.mind.execution.generated_code_api import RUNTIME
from agentd.mind.execution.goal_states import of_goals, raise_state
from agentd.mind.execution.intention_terms import reason_of
from agentd.mind.execution.option_selection import RULE, Options
from agentd.mind.execution.percept_update import Perceived
from agentd.mind.execution.program_loading import copy_mind, load_program
from agentd.mind.execution.query_limits import Asked
from agentd.mind.execution.selection_functions import Chooser, Selector, selectors_of
from agentd.mind.execution.sleep_events import fall_asleep, wake_up
from agentd.mind.execution.team_requests import Request
from agentd.mind.execution.waiting import Wait
from agentd.mind.introspection.decision_log import Decisions
from agentd.mind.introspection.decision_views import DecisionView, FailureView, view_of, views_of
from agentd.mind.introspection.drop_counters import Drops
from agentd.mind.introspection.mind_snapshot import (
    BeliefView,
    EventView,
    IntentionView,
    QuestionView,
    views_of_beliefs,
    views_of_events,
    views_of_intentions,
    views_of_questions,
)
from agentd.mind.persistence.change_tracking import Keeper
from agentd.mind.plans.builtins import Library
from agentd.mind.plans.plan_library import PlanLibrary

MOST_FOCUSES: Final = 100_000
"""So many events and intentions there may be; an agent that raises more floods itself, and the newest are dropped."""

FOR_OTHERS: Final = 10_000
"""So many more there may be of events from outside: an agent that floods itself still hears others."""


MOST_FRAMES: Final = 300_000
"""So many plans an intention may be in the middle of; a goal that calls itself without end fails beyond."""


MOST_MAIL: Final = 100_000
"""So many messages may wait to be taken."""


class Mind:
    """One agent's beliefs, plans, intentions and cycle, with nothing of the world but what is fed in.

    ``name`` is the agent's; ``seed`` starts its random numbers; ``start`` is the mission time in seconds at its birth.
    ``actions`` are the names of the external actions that somebody can perform, None for any; ``names_variables`` says
    that a variable without a value goes out in them, as in the paper's ``arm_motors(True)``. ``clock`` gives the
    mission time when the program asks for it within a cycle; each reading is an input (`TimeRead`). Without a clock
    time stands still within a call of `step`. ``on_input`` is told each input with the number of the cycle that took
    it: fed again in the same cycles they lead to the same effects. ``agents`` tells who can be sent to (None: nobody
    asks). ``has_team`` says that somebody answers each `TeamRequest`. ``ask_timeout`` in seconds bounds synchronous
    asks without a limit of their own. ``epoch`` is the Unix time of mission time 0, and ``zone`` where it is told, for
    ``.date`` and ``.time``. ``decisions`` is how many of the last decisions and failures are remembered
    (`decision_views`); 0: none, which costs nothing. ``on_decision`` is told each of them as it is made.
    ``select_message``, ``select_event``, ``select_option`` and ``select_intention`` choose in place of the defaults; a
    subclass may have methods of these names instead (`agentd.mind.execution.selection_functions`). ``keeper`` notes
    what changes, so that the mind can be kept and restored (`agentd.mind.persistence.change_tracking`).
    """

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
        self.name, self.program = name, program
        self.actions = None if actions is None else frozenset(actions)
        self.names_variables = names_variables
        self.random = random.Random(seed)
        self.now = self.start = start
        self._clock, self.on_input = clock, on_input
        self.cycle = 0
        """How many cycles have been run."""
        self.still = 0
        """Those of them in which percepts came and no intention ran, no event was queued and nothing came out."""
        self.open_beliefs = OpenBeliefs(self)
        opened = self.open_beliefs.install
        self.beliefs = BeliefBase(opened) if keeper is None else keeper.belief_base(opened)
        self.compiler = Library()
        self.plans = PlanLibrary(self.compiler, RUNTIME, self._provide)
        self.events: deque[Event] = deque()
        self.drops = Drops(self)
        """What was dropped because too much waited."""
        self.running: deque[Intention] = deque()
        self.waiting: dict[int, tuple[Intention, Any]] = {}
        """Intentions that wait for something other than an event of theirs, with what must be taken back."""
        self.suspended: dict[int, Intention] = {}
        """Intentions that could run but are suspended, and those whose next event is held."""
        self.current: Intention | None = None
        self.atomic: Intention | None = None
        self.inputs: deque[Input] = deque()
        self.mailbox: deque[Mail] = deque()
        self.effects: list[Effect] = []
        self.timers = Timers()
        self.goal_conditions: list[tuple[Intention, Frame]] = []
        """The frames whose goals end when a condition holds (``<:``)."""
        self.listeners: list[Wait] = []
        self.conditions: list[Wait] = []
        self.queues = (
            self.inputs,
            self.mailbox,
            self.events,
            self.running,
            self.timers.heap,
            self.conditions,
            self.goal_conditions,
        )
        """What a cycle looks at, together: these are never replaced."""
        self.steps_left = MOST_STEPS
        """Steps of work that the formula being computed has left (`agentd.mind.beliefs.work_limit`)."""
        self.changes = 0
        """How often beliefs have changed: formulas that are waited for are asked again when it has grown."""
        self.changes_seen = 0
        """What ``changes`` was when those formulas were asked last."""
        self.action_count = 0
        self.message_count = 0
        self.post_office: Callable[[SendMail], None] | None = None
        """Takes each message as it is sent, or raises `Failed` for the plan; None: messages are effects like others."""
        self.asked: Asked | None = None
        """While a question of another agent is solved: what it may do."""
        self.questions: dict[str, Any] = {}
        """Synchronous asks that wait for their answer, by message id."""
        self.percepts: dict[Signature, Perceived] = {}
        self.performing: dict[int, Intention] = {}
        """The intentions that wait for an action, by its id."""
        self.namespaces: dict[str, dict[str, Any]] = {}
        """Properties of namespaces (``.namespace_set_prop``)."""
        self.future_events: list[Timer] = []
        """Events that ``.at`` raises when they are due."""
        self.agents, self.has_team = agents, has_team
        self.requests: dict[int, Request] = {}
        """What the team was asked for and has not answered."""
        self.ask_timeout = ask_timeout
        self.epoch, self.zone = epoch, zone
        self.failed_handlers: dict[int, int] = {}
        """How often the failure plan of an intention has failed itself and was tried again, by the intention's id."""
        self.asleep: bool | None = False
        """Whether there was nothing left to do (`agentd.mind.execution.sleep_events`); None: who feeds this mind says
        so."""
        self.most_frames: float = MOST_FRAMES
        self.verbose = 1
        """What ``.verbose`` set: 0 prints without the agent's name, 2 shows debugging."""
        self._warned: dict[str, None] = {}
        self.intention_count = 0
        """How many intentions there have been; the id of the last one."""
        self._queries: dict[int, tuple[Any, Any]] = {}
        self.recorder: Decisions | None = None
        self.take_event: Callable[[Mind, Event], bool] = take_event
        """How an event is taken; another function where decisions are recorded."""
        if decisions or on_decision is not None:
            tell = None if on_decision is None else (lambda record: on_decision(view_of(self, record)))
            self.recorder = Decisions(self, max(1, decisions), tell)
            self.take_event = take_event_recorded
        self._cycles = run_cycles
        self._choose(select_message, select_event, select_option, select_intention)
        if keeper is None:
            load_program(self, program)
        else:
            keeper.begin(self, program)
        if self.beliefs.known(RULE) is not None:
            self.choose_by_rule()

    def _choose(self, *given: Selector | None) -> None:
        selectors = selectors_of(self, given)
        chooses = "select_option" in selectors
        self.options = Options(self, selectors.pop("select_option")) if chooses else None
        """What chooses among options, where that is not left to the order of the plans."""
        if selectors:
            self._cycles = Chooser(self, selectors).run_cycles

    def choose_by_rule(self) -> None:
        """Let the program's rules ``select__option`` choose among options, unless a selection function does."""
        if self.options is None:
            self.options = Options(self, None)

    def _provide(self, ref: Ref) -> Any:
        if ref.kind == "predicate":
            return self.beliefs.predicate(ref.what)
        raise KeyError(ref.kind)

    def copy_from(self, other: Mind) -> None:
        """Take over another mind's beliefs, rules and plans, without their events (``.clone``)."""
        copy_mind(self, other)

    def tell_inputs(self, to: Callable[[int, Input], None] | None) -> None:
        """Tell each input to somebody else from now on, or to nobody: ``on_input``."""
        if self.recorder is None:
            self.on_input = to
        else:
            self.recorder.pass_on = to

    def feed(self, item: Input) -> None:
        """Hand in an input; it is taken in the next cycle (mail: one message per cycle, at most `MOST_MAIL` wait)."""
        if type(item) is Mail:
            if len(self.mailbox) >= MOST_MAIL:
                self.drops.note(
                    "messages", f"more than {MOST_MAIL} messages wait; further ones are dropped", item.sender
                )
                return
            self.mailbox.append(item)
        else:
            self.inputs.append(item)

    def step(self, now: float) -> list[Effect]:
        """Run one reasoning cycle at mission time ``now`` and return what it wants done, in order."""
        return self.run(now, 1)

    def run(self, now: float, cycles: int) -> list[Effect]:
        """Run up to so many cycles; stops early when there is an effect to hand out or nothing left to do."""
        if now > self.now:
            self.now = now
        sleeps = self.plans.sleeps
        if sleeps:
            wake_up(self)
        try:
            self._cycles(self, cycles)
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
    def ready(self) -> bool:
        """Whether there is something to do now."""
        if self.inputs or self.effects:
            return True
        if (self.conditions or self.goal_conditions) and self.changes != self.changes_seen:
            return True
        if self.atomic is not None:
            return atomic_can_run(self)
        return bool(self.events or self.running or self.mailbox) or (self.plans.sleeps and self.asleep is False)

    @property
    def wake_at(self) -> float | None:
        """The earliest mission time at which something is due that no input announces; None if there is none."""
        return self.timers.next_due()

    @property
    def idle(self) -> bool:
        """Nothing to do, nothing due and nothing waited for: only an input can wake this mind."""
        return not self.ready and self.wake_at is None and not self.waiting

    def query(self, formula: Any) -> bool:
        """Whether a parsed formula (`agentd.language.parser.parser.parse_formula`) follows from the beliefs.

        It leaves no trace in the mind, whatever rules it uses: who looks on changes nothing.
        """
        known = self._queries.get(id(formula))
        if known is None:
            holds = compile_formula(formula, self.compiler).load(RUNTIME, self.plans.provide)["holds"]
            known = self._queries[id(formula)] = (holds, formula)
        trail: list[Any] = []
        self.steps_left = MOST_STEPS
        own = self.random, self.on_input, self.effects, self.now, self._warned
        self.random, self.on_input, self.effects, self._warned = random.Random(self.cycle), None, [], {}
        try:
            return bool(known[0](self, trail))
        except Exception:  # a function of the program's may raise anything; what cannot be computed does not hold
            return False
        finally:
            undo(trail, 0)
            self.random, self.on_input, self.effects, self.now, self._warned = own

    def intention_views(self, most: int | None = None) -> list[IntentionView]:
        """The intentions as they stand, for people; of many only the first so many."""
        return views_of_intentions(self, most)

    def belief_views(self) -> list[BeliefView]:
        """The beliefs as they stand, for people."""
        return views_of_beliefs(self)

    def event_views(self, most: int) -> list[EventView]:
        """The events that are taken next, for people."""
        return views_of_events(self, most)

    def question_views(self) -> list[QuestionView]:
        """What others were asked and have not answered, for people."""
        return views_of_questions(self)

    def decision_views(self, last: int | None = None, about: str = "") -> list[DecisionView | FailureView]:
        """The last decisions and failures, oldest first, for people; none unless the mind was made to remember any.

        ``about`` is the functor that their events or goals are to have.
        """
        return [] if self.recorder is None else views_of(self, self.recorder.records(), last, about)

    def post(self, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
        """Queue an event that starts an intention of its own; arguments and annotations are resolved."""
        focuses = len(self.events) + len(self.running) + len(self.waiting) + len(self.suspended)
        if focuses >= MOST_FOCUSES and (focuses >= MOST_FOCUSES + FOR_OTHERS or not told_by_others(annots)):
            event = f"{relevant.text}{relevant.sig.indicator}"
            told = f"more than {MOST_FOCUSES} events and intentions; events such as {event} are dropped"
            self.drops.note("events", told, event)
            return
        self.events.append((relevant, args, annots, None))

    @property
    def crowded(self) -> bool:
        """Whether there are as many events and intentions as there may be."""
        return len(self.events) + len(self.running) + len(self.waiting) + len(self.suspended) >= MOST_FOCUSES

    def add_goal(self, literal: Literal, operator: str = "!") -> None:
        """A goal of its own, with its event."""
        relevant = self.plans.relevant("+", operator, literal.sig)
        annots = resolve_annots(with_source(literal.annots))
        if self.plans.has_meta:
            raise_state(self, relevant, literal.args, annots, "pending")
        self.post(relevant, detach(literal.args), annots)

    def add_belief(self, literal: Literal, last: bool = False) -> None:
        """A belief with its event, as an intention of its own."""
        predicate = self.beliefs.predicate(literal.sig)
        relevant = self.plans.relevant("+", "", literal.sig)
        annots = resolve_annots(with_source(literal.annots))
        believe(self, None, predicate, relevant, detach(resolve_all(literal.args)), annots, last)

    def new_intention(self) -> Intention:
        """An intention with the next id, not yet running."""
        self.intention_count += 1
        return Intention(self.intention_count)

    def all_intentions(self) -> list[Intention]:
        """Every intention once: the current one, running, in events, waiting, suspended; by id."""
        found: dict[int, Intention] = {}
        if self.current is not None and self.current.stack:
            found[self.current.id] = self.current
        for intention in self.running:
            found[intention.id] = intention
        for event in self.events:
            if event[3] is not None:
                found[event[3].id] = event[3]
        for intention, _ in self.waiting.values():
            found[intention.id] = intention
        found.update(self.suspended)
        return [found[number] for number in sorted(found)]

    def all_events(self) -> list[Event]:
        """Every event that waits to be given a plan: those of the queue, then those held by ``.suspend``."""
        held = [each.held for each in self.suspended.values() if each.held is not None]
        return [*self.events, *held]

    def await_something(self, intention: Intention, reason: str, token: Any = None) -> None:
        """Take an intention out of the round until `agentd.mind.execution.waiting.resume_waiting`.

        ``token`` is what a drop must take back.
        """
        intention.waiting, intention.since = reason, self.now
        self.waiting[intention.id] = (intention, token)
        if self.plans.has_meta:
            of_goals(self, intention, "waiting", reason_of(self, intention))

    def gone(self, intention: Intention) -> None:
        """An intention has ended, whichever way."""
        if self.atomic is intention:
            self.atomic = None

    def left(self, intention: Intention, frame: Frame) -> None:
        """A frame of a special plan is gone from the stack."""
        if frame[PLAN].atomic and not any(f[PLAN].atomic for f in intention.stack) and self.atomic is intention:
            self.atomic = None

    def read_clock(self) -> float:
        """The mission time now; a reading within a cycle is an input."""
        if self._clock is not None:
            self.now = max(self.now, self._clock())
            if self.on_input is not None:
                self.on_input(self.cycle, TimeRead(self.now))
        return self.now

    def warn_once(self, text: str) -> None:
        """A warning that is told the first time only (of the last thousand)."""
        if text not in self._warned:
            if len(self._warned) > 1000:
                self._warned.clear()
            self._warned[text] = None
            self.effects.append(Log("warning", text))
