"""The state of one mind, and the operations that need nothing else.

Every function of the mind takes a `MindState`; `agentd.mind.mind.Mind` is one with a program.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, tzinfo
from itertools import chain
from random import Random
from typing import Any, Final, Protocol, TypeAlias
from typing import Literal as OneOf

from msgspec.structs import replace

from agentd.language.syntax_tree.signatures import Signature
from agentd.language.terms.source_annotations import told_by_others
from agentd.language.terms.terms import Term, Var
from agentd.mind.beliefs.belief_base import BeliefBase, OpenBeliefs, Predicate
from agentd.mind.beliefs.unification import Trail
from agentd.mind.beliefs.work_limit import MOST_STEPS, Asked
from agentd.mind.data.effects import Effect, Log
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Input, Mail, TimeRead
from agentd.mind.data.intention import PLAN, Event, Frame, Intention, Question, Request, Step, Timer, Timers, Wait
from agentd.mind.data.registry import Library
from agentd.mind.plans.plan_library import PlanLibrary, Relevant
from schemas.wire.mind_records import DropView

MOST_FOCUSES: Final = 100_000
"""Events and intentions at most; an agent that raises more floods itself, and the newest are dropped."""
FOR_OTHERS: Final = 10_000
"""Room beyond that for events from outside: an agent that floods itself still receives those of others."""
MOST_MAIL: Final = 100_000
"""Messages at most that wait to be taken."""
_MOST_WARNED: Final = 1000


class Perceived:
    """The percepts of one signature, with its predicate and the plans for their beginning and end."""

    __slots__ = ("args", "by_key", "gained", "lost", "predicate")

    def __init__(self, predicate: Predicate, gained: Relevant, lost: Relevant) -> None:
        self.args: dict[tuple[Term, ...], bool] = {}
        """Those that hold, each with True."""
        self.predicate, self.gained, self.lost = predicate, gained, lost
        self.by_key: dict[tuple[int, ...], dict[Any, dict[tuple[Term, ...], None]]] = {}
        """For each key that is used, the percepts by their arguments at its positions."""

    def agreeing(self, args: tuple[Term, ...], key: tuple[int, ...]) -> list[tuple[Term, ...]]:
        """Return the percepts with these arguments at the positions ``key``, in time of their number."""
        if not key:
            return list(self.args)
        if len(key) == len(args):
            return [args] if args in self.args else []
        index = self.by_key.get(key)
        if index is None:
            index = self.by_key[key] = {}
            for percept in self.args:
                index.setdefault(_at(key, percept), {})[percept] = None
        return list(index.get(_at(key, args), ()))

    def put(self, args: tuple[Term, ...]) -> bool:
        """Note a percept. Return whether it was not there."""
        before = len(self.args)
        self.args[args] = True
        if len(self.args) == before:
            return False
        if self.by_key:
            for key, index in self.by_key.items():
                index.setdefault(_at(key, args), {})[args] = None
        return True

    def drop(self, args: tuple[Term, ...]) -> bool:
        """Forget a percept. Return whether it was there."""
        if not self.args.pop(args, False):
            return False
        if self.by_key:
            for key, index in self.by_key.items():
                found = index[_at(key, args)]
                del found[args]
                if not found:
                    del index[_at(key, args)]
        return True


def _at(key: tuple[int, ...], args: tuple[Term, ...]) -> Any:
    return args[key[0]] if len(key) == 1 else tuple([args[place] for place in key])


PERIOD: Final = 10.0
"""Mission seconds between two log lines about what is dropped."""
MOST_NAMES: Final = 50
"""Names of dropped items that are counted separately; beyond, only the total is known."""
DropKind: TypeAlias = OneOf["events", "messages", "questions"]


class Drops:
    """Counts of what a mind dropped because too much waited. The first drop of a kind is logged, then the totals."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.by_name: dict[tuple[DropKind, str], DropView] = {}
        """In the order in which each kind and name was dropped first."""
        self._logged: dict[str, tuple[int, float]] = {}
        """The count logged last, and when."""

    def note(self, kind: DropKind, text: str, name: str, now: float) -> Log | None:
        """Count one that is dropped at ``now`` (mission seconds) and return the line to be logged, if any.

        ``text`` is the reason; ``name`` is that of the event, such as ``+tick/1``, or of the sender.
        """
        count = self.counts[kind] = self.counts.get(kind, 0) + 1
        known = self.by_name.get((kind, name))
        if known is not None:
            self.by_name[kind, name] = replace(known, count=known.count + 1, last=now)
        elif len(self.by_name) < MOST_NAMES:
            self.by_name[kind, name] = DropView(what=kind, name=name, count=1, first=now, last=now, reason=text)
        logged = self._logged.get(kind)
        if logged is not None and now < logged[1] + PERIOD:
            return None
        self._logged[kind] = (count, now)
        return Log("warning", text if logged is None else f"{text} ({count} so far)")

    def unlogged(self, now: float) -> list[Log]:
        """Return the totals that grew since they were logged last: for a run's end, at ``now`` in mission seconds."""
        left = {kind: count for kind, count in self.counts.items() if count > self._logged[kind][0]}
        self._logged.update((kind, (count, now)) for kind, count in left.items())
        return [Log("warning", f"{count} {kind} were dropped in all") for kind, count in left.items()]


class Recorder(Protocol):
    """Takes a mind's decisions and failures: `agentd.mind.introspection.decision_log.Decisions`."""

    def given(self, cycle: int, item: Input) -> None:
        """Note an input of the cycle with this number."""

    def posted(self, event: Event) -> None:
        """Note the origin of an event that has just been queued."""

    def decided(self, event: Event, args: tuple[Term, ...], rejected: Any, frame: Frame | None, bound: bool) -> None:
        """Note which plan was chosen for an event."""

    def failed(
        self, intention: Intention | None, failed: Failed, frames: Sequence[Frame], handler: Relevant | None
    ) -> None:
        """Note a failure, and the plans that end with it."""

    def dropped(self, frames: Sequence[Frame]) -> None:
        """Note plans that are dropped, the innermost last."""

    def dropped_by(self, frame: Frame) -> tuple[bool, Step | None]:
        """Return whether a plan was dropped, and the formula that has done it."""

    def last_rejected(self) -> Sequence[tuple[Any, Any]]:
        """Return the plans that were tried in vain for the last event, and why."""


class Turns(Protocol):
    """Moves what a cycle takes next to the front of its queue. False: nothing is to be taken in this cycle."""

    def message(self) -> bool:
        """Choose one of the messages, of which there are some."""

    def event(self) -> bool:
        """Choose one of the events, of which there are some."""

    def intention(self) -> bool:
        """Choose one of the intentions that can run, if there is any."""

    def over(self) -> bool:
        """Return whether nothing is left to do, after a cycle that has run no intention."""


class Origins(Protocol):
    """Notes where intentions come from: `agentd.mind.persistence.pending_events.Origins`."""

    def take(self, event: Event) -> None:
        """Note an event that is to get a plan."""

    def taken(self, event: Event) -> None:
        """Note what has become of it."""


@dataclass(slots=True, eq=False, repr=False, kw_only=True)
class MindState:
    """What one mind believes, plans, intends and waits for. Times are mission times in seconds."""

    name: str
    beliefs: BeliefBase
    compiler: Library
    plans: PlanLibrary
    random: Random
    start: float
    """When it was made."""
    now: float
    cycle: int = 0
    """How many cycles have been run."""
    still: int = 0
    """Those of them in which percepts came and no intention ran, no event was queued and nothing came out."""

    # --- events and intentions ---
    events: deque[Event] = field(default_factory=deque)
    running: deque[Intention] = field(default_factory=deque)
    waiting: dict[int, tuple[Intention, Any]] = field(default_factory=dict)
    """Each intention that waits for something other than its own event, by id, with the token that a drop cancels."""
    suspended: dict[int, Intention] = field(default_factory=dict)
    """Intentions that could run but are suspended, and those whose next event is held."""
    current: Intention | None = None
    atomic: Intention | None = None
    intention_count: int = 0
    """How many intentions there have been; the id of the last one."""
    goal_conditions: list[tuple[Intention, Frame]] = field(default_factory=list)
    """The frames whose goals end when a condition holds (``<:``)."""
    failed_handlers: dict[int, int] = field(default_factory=dict)
    """How often the failure plan of an intention has failed itself and was tried again, by the intention's id."""

    # --- inputs and effects ---
    inputs: deque[Input] = field(default_factory=deque)
    mailbox: deque[Mail] = field(default_factory=deque)
    percepts: dict[Signature, Perceived] = field(default_factory=dict)
    effects: list[Effect] = field(default_factory=list)
    drops: Drops = field(default_factory=Drops)
    """Counts of dropped events, messages and questions."""

    # --- waiting ---
    timers: Timers = field(default_factory=Timers)
    future_events: list[Timer] = field(default_factory=list)
    """Events that ``.at`` raises when they are due."""
    listeners: list[Wait] = field(default_factory=list)
    conditions: list[Wait] = field(default_factory=list)
    changes: int = 0
    """How often beliefs have changed: formulas that are waited for are asked again when it has grown."""
    changes_seen: int = 0
    """The value of ``changes`` when those formulas were evaluated last."""
    action_client: dict[int, Intention] = field(default_factory=dict)
    """The intentions that wait for an action, by its id."""
    questions: dict[str, Question] = field(default_factory=dict)
    """Synchronous asks that wait for their answer, by message id."""
    requests: dict[int, Request] = field(default_factory=dict)
    """Requests to the team that it has not answered, by id."""
    action_count: int = 0
    message_count: int = 0

    # --- limits and settings ---
    steps_left: int = MOST_STEPS
    """Steps of work that the formula being computed has left (`agentd.mind.beliefs.work_limit`)."""
    asked: Asked | None = None
    """The limits of another agent's question while it is solved."""
    most_frames: float
    """Plans that an intention may be in the middle of."""
    actions: frozenset[str] | None = None
    """Names of the external actions that can be performed; None: any."""
    names_variables: bool = False
    """Whether actions may contain variables without a value."""
    has_team: bool = False
    """Whether each `TeamRequest` is answered."""
    ask_timeout: float | None = None
    """Seconds that a synchronous ask without a limit of its own waits at most."""
    epoch: float = 0.0
    """Unix time of mission time 0, in seconds."""
    zone: tzinfo = UTC
    verbose: int = 1
    """Set by ``.verbose``: 0 prints without the agent's name, 2 shows debugging."""
    namespaces: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Properties of namespaces (``.namespace_set_prop``)."""
    asleep: bool | None = False
    """Whether nothing was left to do (`agentd.mind.mind`); None: the runtime decides."""
    warned: dict[str, None] = field(default_factory=dict)

    # --- hooks; None if unused ---
    clock: Callable[[], float] | None = None
    """Gives the mission time within a cycle; None: time is constant within `Mind.step`."""
    agents: Callable[[], Iterable[str]] | None = None
    """Names of the agents that can be sent to; None: no receiver is checked."""
    on_input: Callable[[int, Input], None] | None = None
    """Gets each input with the number of the cycle that takes it."""
    post_office: Callable[[Mail], None] | None = None
    """Takes each message as it is sent, or raises `Failed` for the plan; None: messages are effects like others."""
    recorder: Recorder | None = None
    """Gets each decision and failure, and what may cause them; None: decisions are not recorded."""
    origins: Origins | None = None
    """Is notified before and after each event is given a plan; None: the mind is not kept."""
    turns: Turns | None = None
    """Chooses what is next; None: the oldest message, the oldest event, and intentions in turn."""

    open_beliefs: OpenBeliefs = field(init=False)
    queues: tuple[
        deque[Input],
        deque[Mail],
        deque[Event],
        deque[Intention],
        list[Timer],
        list[Wait],
        list[tuple[Intention, Frame]],
    ] = field(init=False)
    """The queues that a cycle examines, as one tuple; they are never replaced."""

    def __post_init__(self) -> None:
        self.open_beliefs = OpenBeliefs(lambda: chain.from_iterable(each.stack for each in self.all_intentions()))
        self.queues = (
            self.inputs,
            self.mailbox,
            self.events,
            self.running,
            self.timers.heap,
            self.conditions,
            self.goal_conditions,
        )

    # --- inputs ---

    def feed(self, item: Input) -> None:
        """Hand in an input; it is taken in the next cycle (mail: one message per cycle, at most `MOST_MAIL` wait)."""
        if type(item) is Mail:
            if len(self.mailbox) >= MOST_MAIL:
                self.drop("messages", f"more than {MOST_MAIL} messages wait; further ones are dropped", item.sender)
                return
            self.mailbox.append(item)
        else:
            self.inputs.append(item)

    def drop(self, kind: DropKind, text: str, name: str = "") -> None:
        """Count a dropped item, and log it from time to time: see `Drops.note`."""
        self.timers.looks += 1
        log = self.drops.note(kind, text, name, self.now)
        if log is not None:
            self.effects.append(log)

    def read_clock(self) -> float:
        """Return the mission time now; a reading within a cycle is an input."""
        if self.clock is not None:
            self.now = max(self.now, self.clock())
            if self.on_input is not None:
                self.on_input(self.cycle, TimeRead(self.now))
        return self.now

    def warn_once(self, text: str) -> None:
        """Log a warning unless it is among the last thousand."""
        if text not in self.warned:
            if len(self.warned) > _MOST_WARNED:
                self.warned.clear()
            self.warned[text] = None
            self.effects.append(Log("warning", text))

    # --- readiness ---

    @property
    def ready(self) -> bool:
        """Whether a cycle would do something now."""
        if self.inputs or self.effects:
            return True
        if self.atomic is None and (self.mailbox or self.events or self.running):
            return True
        if (self.conditions or self.goal_conditions) and self.changes != self.changes_seen:
            return True
        if self.atomic is not None:
            return self.atomic_can_run
        return self.plans.sleeps and self.asleep is False

    @property
    def crowded(self) -> bool:
        """Whether there are as many events and intentions as there may be."""
        return len(self.events) + len(self.running) + len(self.waiting) + len(self.suspended) >= MOST_FOCUSES

    @property
    def atomic_can_run(self) -> bool:
        """Whether there is a message to take, or the atomic intention has a formula to run or an event to be taken."""
        atomic = self.atomic
        if (self.mailbox and not self.crowded) or atomic in self.running:
            return True
        return any(e[3] is atomic for e in reversed(self.events))  # its own is one of the last as a rule

    # --- events and intentions ---

    def post(self, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]) -> None:
        """Queue an event that starts an intention of its own; arguments and annotations are resolved."""
        events = self.events
        focuses = len(events) + len(self.running) + len(self.waiting) + len(self.suspended)
        if focuses >= MOST_FOCUSES and (focuses >= MOST_FOCUSES + FOR_OTHERS or not told_by_others(annots)):
            event = f"{relevant.text}{relevant.sig.indicator}"
            text = f"more than {MOST_FOCUSES} events and intentions; events such as {event} are dropped"
            self.drop("events", text, event)
            return
        events.append((relevant, args, annots, None))
        if self.recorder is not None:
            self.recorder.posted(events[-1])

    def all_events(self) -> list[Event]:
        """Return every event that waits to be given a plan: those of the queue, then those held by ``.suspend``."""
        held = [each.held for each in self.suspended.values() if each.held is not None]
        return [*self.events, *held]

    @property
    def own_intention(self) -> Intention:
        """The intention that runs the formula in hand. Raises RuntimeError if none does."""
        if self.current is None:
            raise RuntimeError("no intention runs")
        return self.current

    def new_intention(self) -> Intention:
        """Return an intention with the next id, not yet running."""
        self.intention_count += 1
        return Intention(self.intention_count, [], [])

    def all_intentions(self) -> list[Intention]:
        """Return every intention once: the current one, running, in events, waiting, suspended; by id."""
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

    def gone(self, intention: Intention) -> None:
        """Note that an intention has ended, whichever way."""
        if self.atomic is intention:
            self.atomic = None

    def left(self, intention: Intention, frame: Frame) -> None:
        """Note that a frame of a special plan is off the stack."""
        if frame[PLAN].atomic and not any(f[PLAN].atomic for f in intention.stack) and self.atomic is intention:
            self.atomic = None

    # --- beliefs with free variables ---

    def begin_scopes(self) -> None:
        """From now on give each taken event and each rule that is asked a scope
        (`agentd.mind.beliefs.belief_base`)."""
        if not self.open_beliefs.installed:
            self.open_beliefs.installed = True
            self.plans.select_within(self.open_beliefs.select_in_scope)
            for predicate in self.beliefs.predicates():
                predicate.forget_code()

    def scope(self, trail: Trail) -> dict[Var, Var]:
        """Return the scope of the current evaluation."""
        current = self.current
        if current is None or not current.stack or trail is not current.trail:
            return self.open_beliefs.here(None)
        return self.open_beliefs.here(current.stack[-1])
