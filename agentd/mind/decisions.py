"""Decision records: the last decisions of a mind, each with the plans that were rejected and why, and what failed.

A mode of the compiled mind: with it plans are compiled so that they tell which literal of their context failed
(`agentd.language.compile_select`), and events are taken through `Decisions.select`. Without it nothing here runs.

A record holds what it is about by reference where that cannot change any more and as a short copy where it can
(`agentd.mind.holding`), so it shows the state at the time of the decision. It becomes text only when somebody looks
(`agentd.mind.decision_views`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from agentd.language.signatures import Signature, signature
from agentd.language.sources import PERCEPT, SELF, SOURCE_SELF
from agentd.language.terms import Literal, deref, elements
from agentd.mind.failed import Failed
from agentd.mind.failure_facts import context_failed
from agentd.mind.frames import VARIABLES, Frame, Step
from agentd.mind.holding import held, held_all
from agentd.mind.inputs import BeliefAdded, GoalAdded, Input, Mail, SignalRaised
from agentd.mind.nested import nested_plans
from agentd.mind.unifier import Trail, undo


class Decision(NamedTuple):
    """An event, the plans tried for it in order, and the one that was chosen."""

    cycle: int
    time: float
    """Mission time in seconds."""
    event: Any
    """What was taken from the queue; its arguments and annotations may have changed since."""
    below: Frame | None
    """The frame of the plan that raised the event and waits for it."""
    asked: Step | None
    """The formula that raised the event; None if none waits for it."""
    rejected: Sequence[tuple[Any, Any]] | None
    """Each plan that was tried in vain, and why: see `compile_select`; an exception for a context that has no value."""
    frame: Frame | None
    """The frame of the chosen plan. What selection put into its places stays there."""
    annots: tuple[Any, ...]
    """The annotations of the event as they were."""
    begun: int = 0
    """The id of the intention that the chosen plan begins; 0 if it is for one that there was."""
    origin: Origin | None = None
    """Where an event that starts an intention comes from."""
    args: tuple[Any, ...] | None = None
    """The arguments of the event as they were, before any plan was tried; None if they cannot have changed."""
    values: tuple[Any, ...] | None = None
    """The variables of the frame as they were then; None if the event has no variables and selection bound none: then
    those that are cells in the frame were free."""

    @property
    def relevant(self) -> Any:
        return self.event[0]

    @property
    def shown_args(self) -> tuple[Any, ...]:
        """The arguments as they were."""
        found: tuple[Any, ...] = self.event[1] if self.args is None else self.args
        return found

    @property
    def intention(self) -> int:
        """The id of the intention that the plan is for; 0 if there is none."""
        return self.begun if self.event[3] is None else int(self.event[3].id)


class Failure(NamedTuple):
    """A formula that failed, or a goal that found no plan, and the plans that ended with it."""

    cycle: int
    time: float
    intention: int
    code: Any
    """The formula or goal as a term, with the values of its variables."""
    failed: Failed
    frames: tuple[Frame, ...]
    """The frames that were given up, innermost first (at most `MOST_FRAMES`)."""
    handler: Any
    """The `Relevant` of the event ``-!g`` that goes on from here; None if nothing handles the failure."""


Origin = tuple[Input | None, int, Step | None]
"""Where an event that starts an intention comes from: an input, or the id of an intention and its formula that raised
it; none of them for what the program starts with."""


class Posted(tuple[Any, ...]):
    """An event that starts an intention and knows where it comes from."""

    origin: Origin | None = None


MOST_FRAMES: Final = 20
"""So many of the plans that end with a failure are noted."""

_KQML: Final = signature("kqml_received", 4)


class Decisions:
    """The last decisions and failures of a mind, at most ``most`` of both together.

    ``tell`` is called with each record as soon as it is made.
    """

    def __init__(self, mind: Any, most: int, tell: Callable[[Decision | Failure], None] | None = None) -> None:
        self._mind, self._tell = mind, tell
        self._last: deque[Any] = deque(maxlen=most)
        self._note: Callable[[Any], None] = self._last.append if tell is None else self._append
        self._post, self._on_input = mind.post, mind.on_input
        self._dropped: deque[Frame] = deque(maxlen=most)
        self._given: list[Any] = []
        self._given_in = 0
        """The inputs that may raise events, and the cycle in which they came."""
        if mind.compiler.form == "select":
            mind.compiler.form = "trace"
        plans = mind.plans
        plans.select, plans.select_nested, plans.select_noted = self.select, self.select_nested, self.select_noted
        mind.post, mind.on_input = self.post, self.on_input

    def records(self) -> list[Decision | Failure]:
        """What is remembered, oldest first."""
        return [entry if type(entry) is Failure else Decision(*entry) for entry in self._last]

    def last_rejected(self) -> Sequence[tuple[Any, Any]]:
        """The plans that were tried in vain for the last event, as `Decision.rejected` holds them."""
        last = self._last[-1] if self._last else None
        return () if type(last) is not tuple else Decision(*last).rejected or ()

    def select(
        self, mind: Any, trail: Trail, event: Any, rejected: list[tuple[Any, Any]] | None = None
    ) -> Frame | None:
        """Find the plan for an event as a mind without records does, and note how; ``rejected`` were tried before.

        This is on the path of every event: what is seldom needed stands in the methods below.
        """
        relevant, args, annots, intention = event
        shown = args
        for term in args:
            if type(term) is not float and type(term) is not str and not (type(term) is Literal and term.ground):
                shown = held_all(args)
                break
        frame = None
        mark = len(trail)
        try:
            for plan in relevant.plans:
                found = plan.trace(mind, trail, relevant, args, annots)
                if type(found) is list:
                    frame = found
                    break
                if len(trail) > mark:
                    undo(trail, mark)
                if rejected is None:
                    rejected = [(plan, found)]
                else:
                    rejected.append((plan, found))
        except Exception as error:
            return self._select_after(trail, event, plan, [*(rejected or ()), self._broken(relevant, plan, error)])
        if frame is None or shown is not args or len(trail) > mark:
            self.decided(event, shown, rejected, frame, None if frame is None else frame[VARIABLES:])
            return frame
        if annots is not SELF and annots is not PERCEPT:
            annots = held_all(annots)
        if intention is not None:
            stack = intention.stack
            below = stack[-1] if stack else None
            self._note((mind.cycle, mind.now, event, below, intention.last, rejected, frame, annots))
        else:
            origin = event.origin if type(event) is Posted else None
            begun = mind.intention_count + 1
            self._note((mind.cycle, mind.now, event, None, None, rejected, frame, annots, begun, origin))
        return frame

    def select_nested(self, mind: Any, trail: Trail, event: Any) -> Frame | None:
        """As `select`, for programs with nested plans: those in sight come first."""
        relevant, args, annots, intention = event
        shown = held_all(args)
        rejected: list[tuple[Any, Any]] = []
        mark = len(trail)
        for plan, around in nested_plans(mind, relevant, intention):
            try:
                found = plan.trace(mind, trail, relevant, args, annots, around)
            except Exception as error:
                found = self._broken(relevant, plan, error)[1]
            if type(found) is list:
                self.decided(event, shown, rejected, found, found[VARIABLES:])
                return found
            undo(trail, mark)
            rejected.append((plan, found))
        return self.select(mind, trail, event, rejected or None)

    def _select_after(self, trail: Trail, event: Any, broken: Any, rejected: list[tuple[Any, Any]]) -> Frame | None:
        """The plans after one whose context could not be computed."""
        relevant, args, annots, _ = event
        mind, shown, mark = self._mind, held_all(args), len(trail)
        frame: Frame | None = None
        for plan in relevant.plans[relevant.plans.index(broken) + 1 :]:
            try:
                found = plan.trace(mind, trail, relevant, args, annots)
            except Exception as error:
                found = self._broken(relevant, plan, error)[1]
            if type(found) is list:
                frame = found
                break
            undo(trail, mark)
            rejected.append((plan, found))
        self.decided(event, shown, rejected, frame, None if frame is None else frame[VARIABLES:])
        return frame

    def _broken(self, relevant: Any, plan: Any, error: Exception) -> tuple[Any, Exception]:
        """A plan whose context could not be computed, which is told; an internal action may raise anything."""
        context_failed(self._mind, relevant, plan, error)
        return plan, error.with_traceback(None)

    def select_noted(self, mind: Any, trail: Trail, event: Any) -> Frame | None:
        """As `select`, for programs whose contexts ask for the intention in hand."""
        mind.plans.taken = event
        try:
            return self.select_nested(mind, trail, event)
        finally:
            mind.plans.taken = None

    def decided(self, event: Any, args: Any, rejected: Any, frame: Frame | None, values: list[Any] | None) -> None:
        """Note a decision in full."""
        mind = self._mind
        relevant, _, annots, intention = event
        below = asked = origin = None
        begun = 0
        if intention is not None:
            asked = intention.last
            if intention.stack:
                below = intention.stack[-1]
        else:
            if frame is not None:
                begun = mind.intention_count + 1
            elif rejected is None and not relevant.goal:
                return  # a belief that no plan is for
            if type(event) is Posted:
                origin = event.origin
        held = None if values is None else held_all(tuple(values))
        start = (mind.cycle, mind.now, event, below, asked, rejected, frame)
        self._note((*start, held_all(annots), begun, origin, args, held))

    def failed(self, intention: Any, failed: Failed, frames: Sequence[Frame], handler: Any) -> None:
        """Note a failure: see `Failure`."""
        mind = self._mind
        failed.__traceback__ = failed.__context__ = None  # they would keep alive what the failed call has used
        number = 0 if intention is None else intention.id
        record = Failure(mind.cycle, mind.now, number, held(failed.code), failed, tuple(frames), handler)
        self._note(record)

    def dropped(self, frames: Sequence[Frame]) -> None:
        """Note the frames of plans that were dropped, the innermost last."""
        self._dropped.extend(frames[-MOST_FRAMES:])

    def was_dropped(self, frame: Frame) -> bool:
        """Whether a plan was dropped, as far as is remembered."""
        return any(frame is dropped for dropped in self._dropped)

    def _append(self, entry: Any) -> None:
        """Note a record and tell it."""
        self._last.append(entry)
        if self._tell is not None:
            self._tell(entry if type(entry) is Failure else Decision(*entry))

    def post(self, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
        """Queue an event that starts an intention of its own, with where it comes from."""
        origin = self._origin(relevant, annots)
        events = self._mind.events
        before = len(events)
        self._post(relevant, args, annots)
        if origin is not None and len(events) > before:
            event = Posted(events.pop())
            event.origin = origin
            events.append(event)

    def _origin(self, relevant: Any, annots: tuple[Any, ...]) -> Origin | None:
        mind = self._mind
        if self._given_in == mind.cycle:
            for item in self._given:
                if _raises(item, relevant.sig):
                    return item, 0, None
        if annots is SELF or (annots is not PERCEPT and SOURCE_SELF in annots and relevant.operator != "^"):
            current = mind.current
            return (None, 0, None) if current is None else (None, current.id, current.last)
        return None  # a percept, a timer, the state of a goal

    def on_input(self, cycle: int, item: Input) -> None:
        """Note what may raise events in this cycle."""
        if isinstance(item, _RAISING):
            if self._given_in != cycle:
                self._given.clear()
                self._given_in = cycle
            self._given.append(item)
        if self._on_input is not None:
            self._on_input(cycle, item)


_RAISING = (Mail, GoalAdded, BeliefAdded, SignalRaised)


def _raises(item: Any, sig: Signature) -> bool:
    """Whether an event of this signature can come from an input."""
    if type(item) is not Mail:
        return bool(item.literal.sig is sig)
    content = deref(item.content)
    if type(content) is Literal:
        return content.sig is sig or sig is _KQML
    return sig is _KQML or any(type(deref(c)) is Literal and deref(c).sig is sig for c in elements(content))
