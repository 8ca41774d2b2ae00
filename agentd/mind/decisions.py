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

from agentd.language.signatures import signature
from agentd.language.sources import SELF, SOURCE_SELF
from agentd.language.terms import Literal, Var, deref, proper
from agentd.mind.failed import Failed, InContext
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
    relevant: Any
    args: tuple[Any, ...]
    annots: tuple[Any, ...]
    """The event as it was before any plan was tried."""
    intention: int
    """The id of the intention that the plan is for; 0 if there is none."""
    below: Frame | None
    """The frame of the plan that raised the event and waits for it."""
    asked: Step | None
    """The formula that raised the event; None if none waits for it."""
    origin: Origin | None
    """Where an event that starts an intention comes from."""
    rejected: Sequence[tuple[Any, Any]]
    """Each plan that was tried in vain, and why: see `compile_select`; an exception for a context that has none."""
    frame: Frame | None
    """The frame of the chosen plan."""
    values: tuple[Any, ...]
    """The variables of that frame as they were then."""


class Failure(NamedTuple):
    """A formula that failed, or a goal that found no plan, and the plans that ended with it."""

    cycle: int
    time: float
    intention: int
    step: Step | None
    code: Any
    """The formula as a term, with the values of its variables."""
    failed: Failed
    frames: tuple[Frame, ...]
    """The frames that were given up, innermost first (at most `MOST_FRAMES`)."""
    handler: Any
    """The `Relevant` of the event ``-!g`` that goes on from here; None if nothing handles the failure."""


class Origin(NamedTuple):
    """Where an event that starts an intention comes from."""

    cause: Input | None
    """The input that raised it."""
    intention: int
    step: Step | None
    """The intention and formula that raised it."""


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
        self._causes: dict[Any, Input] = {}
        self._cycle = 0
        self.rejected: list[tuple[Any, Any]] = []
        """The plans that were tried in vain for the event that was taken last."""
        mind.compiler.form = "trace"
        mind.plans.select = self.select
        mind.post, mind.on_input = self.post, self.on_input

    def records(self) -> list[Decision | Failure]:
        """What is remembered, oldest first."""
        return [entry if type(entry) is Failure else Decision._make(entry) for entry in self._last]

    def select(self, mind: Any, trail: Trail, event: Any) -> Frame | None:
        """Find the plan for an event as a mind without records does, and note how."""
        relevant, args, annots, intention = event
        shown = args
        for term in args:
            kind = type(term)
            if kind is not float and kind is not str and not (kind is Literal and term.ground):
                shown = held_all(args)
                break
        shown_annots = annots if annots is SELF else held_all(annots)
        rejected = self.rejected = []
        frame: Frame | None = None
        values: tuple[Any, ...] = ()
        plan = trouble = None
        mark = len(trail)
        mind.plans.taken = event
        try:
            if mind.plans.has_nested:
                frame = self._nested(trail, event)
            for plan in relevant.plans if frame is None else ():
                found = plan.trace(mind, trail, relevant, args, annots)
                if type(found) is list:
                    frame = found
                    break
                if len(trail) > mark:
                    undo(trail, mark)
                rejected.append((plan, found))
        except Exception as error:
            rejected.append((plan, error))
            trouble = InContext(plan, error)
        mind.plans.taken = None
        if frame is not None:
            values = tuple(frame[VARIABLES:])
            for value in values:
                if type(value) is Var:
                    values = held_all(values)
                    break
        elif not (rejected or relevant.goal):
            return None
        if intention is not None:
            stack = intention.stack
            below = stack[-1] if stack else None
            number, asked, origin = intention.id, intention.last, None
        else:
            below = asked = None
            number = mind.intention_count + 1 if frame is not None else 0
            origin = event.origin if type(event) is Posted else None
        event = (relevant, shown, shown_annots)
        self._note((mind.cycle, mind.now, *event, number, below, asked, origin, rejected, frame, values))
        if trouble is not None:
            raise trouble
        return frame

    def _nested(self, trail: Trail, event: Any) -> Frame | None:
        relevant, args, annots, intention = event
        mark = len(trail)
        for plan, around in nested_plans(self._mind, relevant, intention):
            found = plan.trace(self._mind, trail, relevant, args, annots, around)
            if type(found) is list:
                return found
            undo(trail, mark)
            self.rejected.append((plan, found))
        return None

    def failed(self, intention: Any, step: Step | None, code: Any, failed: Failed, frames: Any, handler: Any) -> None:
        """Note a failure: see `Failure`."""
        mind = self._mind
        number = 0 if intention is None else intention.id
        record = Failure(mind.cycle, mind.now, number, step, held(code), failed, tuple(frames), handler)
        self._note(record)

    def _append(self, entry: Any) -> None:
        """Note a record and tell it."""
        self._last.append(entry)
        if self._tell is not None:
            self._tell(entry if type(entry) is Failure else Decision._make(entry))

    def post(self, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
        """Queue an event that starts an intention of its own, with where it comes from."""
        events = self._mind.events
        before = len(events)
        self._post(relevant, args, annots)
        if len(events) > before:
            event = Posted(events.pop())
            event.origin = self._origin(relevant, annots)
            events.append(event)

    def _origin(self, relevant: Any, annots: tuple[Any, ...]) -> Origin | None:
        mind = self._mind
        if self._cycle == mind.cycle and (cause := self._causes.get(relevant.sig)) is not None:
            return Origin(cause, 0, None)
        current = mind.current
        if relevant.operator != "^" and (annots is SELF or SOURCE_SELF in annots):
            return Origin(None, 0, None) if current is None else Origin(None, current.id, current.last)
        return None  # a percept, a timer, the state of a goal

    def on_input(self, cycle: int, item: Input) -> None:
        """Note what may raise events in this cycle."""
        if cycle != self._cycle:
            self._causes.clear()
            self._cycle = cycle
        match item:
            case GoalAdded() | BeliefAdded() | SignalRaised():
                self._causes[item.literal.sig] = item
            case Mail():
                members = proper(item.content)
                for content in [item.content] if members is None else members:
                    literal = deref(content)
                    if type(literal) is Literal:
                        self._causes[literal.sig] = item
                self._causes[_KQML] = item
        if self._on_input is not None:
            self._on_input(cycle, item)
