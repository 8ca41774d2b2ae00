"""The decision log: the last decisions of a mind with the rejected plans and the reasons, and the last failures.

It is a mode of the compiled mind: plans are compiled to return the literal of their context that failed
(`agentd.language.compiler.units`), and `Decisions.select_in_order` finds the plans for events. Without it
nothing here runs.

A record refers to immutable terms, and holds short copies of others (`agentd.mind.introspection.snapshots`), so it
shows the state at the time of the decision. It becomes text on demand only
(`agentd.mind.introspection.decision_views`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from agentd.language.syntax_tree.signatures import Signature, signature
from agentd.language.terms.source_annotations import PERCEPT, SELF, SOURCE_SELF
from agentd.language.terms.terms import LargeLists, Literal, Term, deref, elements
from agentd.mind.beliefs.unification import Trail, undo
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import BeliefAdded, GoalAdded, Input, Mail, SignalRaised
from agentd.mind.data.intention import VARIABLES, Event, Frame, Intention, Step
from agentd.mind.introspection.failure_text import context_failed
from agentd.mind.introspection.snapshots import held, held_all, lighten
from agentd.mind.plans.nested_plans import candidates
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState


class Decision(NamedTuple):
    """An event, the plans tried for it in order, and the one that was chosen."""

    cycle: int
    time: float
    """Mission time in seconds."""
    event: Event
    """As taken from the queue; its arguments and annotations may have changed since."""
    below: Frame | None
    """The frame of the plan that raised the event and waits for it."""
    asked: Step | None
    """The formula that raised the event; None if none waits for it."""
    rejected: Sequence[tuple[Any, Any]] | None
    """Each plan that was tried in vain, and why: see `compile_select`; an exception for a context that has no value."""
    frame: Frame | None
    """The frame of the chosen plan, whose places keep the values put in by selection."""
    annots: tuple[Any, ...]
    """The annotations of the event as they were."""
    begun: int = 0
    """The id of the intention that the chosen plan begins; 0 if it is for one that there was."""
    origin: Origin | None = None
    """The origin of an event that starts an intention."""
    args: tuple[Any, ...] | None = None
    """The arguments of the event as they were, before any plan was tried; None if they cannot have changed."""
    values: tuple[Any, ...] | None = None
    """The variables of the frame as they were then; None if the event has no variables and selection bound none: then
    those that are cells in the frame were free."""

    @property
    def relevant(self) -> Relevant:
        """The plans that were relevant."""
        return self.event[0]

    @property
    def shown_args(self) -> tuple[Term, ...]:
        """The arguments as they were."""
        found: tuple[Term, ...] = self.event[1] if self.args is None else self.args
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
    """The `Relevant` of the event ``-!g`` that handles the failure, or None."""


Origin = tuple[Input | None, int, Step | None]
"""The origin of an event that starts an intention: an input, or the id of an intention and its formula that raised it;
neither for initial beliefs and goals."""
_Raising: TypeAlias = Mail | GoalAdded | BeliefAdded | SignalRaised
"""The inputs that may raise events, made once: it is asked for each message."""


MOST_FRAMES: Final = 20
"""Frames noted of the plans that end with a failure."""

_KQML: Final = signature("kqml_received", 4)


def record_of(entry: Any) -> Decision | Failure:
    """Return the record of an entry of `Decisions`."""
    return entry if type(entry) is Failure else Decision(*entry)


class Decisions:
    """The last decisions and failures of a mind, at most ``most`` of both together.

    ``listener`` is called with each record as soon as it is made.
    """

    def __init__(
        self, mind: MindState, most: int, listener: Callable[[Decision | Failure], None] | None = None
    ) -> None:
        self._mind, self._listener = mind, listener
        self._last: deque[Any] = deque(maxlen=most)
        self.waiting: list[Any] = []
        """While they are counted: those that `settle` has not counted yet."""
        self.count = 0
        """How many there have been since `count_all`."""
        self._taken = 0
        self._settled: Callable[[list[Any]], None] | None = None
        self.note: Callable[[Any], None] = self._noting(self._last)
        """Takes the fields of a `Decision` as a tuple (the last ones may be left out), or a `Failure`."""
        self._dropped: deque[tuple[Frame, Step | None]] = deque(maxlen=most)
        self.shown: dict[int, tuple[Any, Any]] = {}
        """The views made of entries for observers, by identity of the entry; `let_go` clears it too."""
        self.large_lists = LargeLists.made
        """How many large lists had been made when `let_go` looked last."""
        self._origins: dict[int, tuple[Any, Origin]] = {}
        """The origins of waiting events, by identity of the event, which this keeps alive."""
        self._given: list[_Raising] = []
        self._given_in = -1
        """The inputs that may raise events, and the cycle in which they came."""
        if mind.compiler.form == "select":
            mind.compiler.form = "trace"
        mind.plans.select, mind.plans.select_slowly = self.select_in_order, self.select

    def entries(self) -> list[Any]:
        """Return them, oldest first, as they are held: `record_of` makes records of them."""
        self.settle()
        return list(self._last)

    def count_all(self, settled: Callable[[list[Any]], None] | None = None) -> None:
        """Count the records from now on, for `take_new`. `settle` must be called after each run of the mind; it passes
        the new ones to ``settled``. There should be few, as those in between take fresh memory.
        """
        self.settle()
        self._taken, self._settled = self.count, settled
        self.note = self._noting(self.waiting)

    def count_none(self) -> None:
        """Count the records no longer."""
        self.settle()
        self._settled = None
        self.note = self._noting(self._last)

    def settle(self) -> None:
        """Put the new records to the others."""
        new = self.waiting
        if not new:
            return
        if self._settled is not None:
            self._settled(new)
        self.count += len(new)
        self._last.extend(new)
        new.clear()

    def take_new(self, most: int) -> tuple[int, int]:
        """Return how many of the last records are new since the last call, at most ``most``, and how many more there
        were.
        """
        self.settle()
        new, self._taken = self.count - self._taken, self.count
        shown = min(new, most, len(self._last))
        return shown, new - shown

    def let_go(self) -> None:
        """Cut large terms to the part that is shown, so that records stay small however large lists become.

        Records hold the frames of plans; the frame of an ended plan is used by nothing else.
        """
        self.large_lists = LargeLists.made
        self.shown.clear()
        self.settle()
        alive = {id(frame) for intention in self._mind.all_intentions() for frame in intention.stack}
        for place, entry in enumerate(self._last):
            frames = entry.frames if type(entry) is Failure else (Decision(*entry).below, Decision(*entry).frame)
            for frame in frames:
                if frame is not None and id(frame) not in alive:
                    lighten(frame)
            if type(entry) is tuple:
                relevant, args, annots, intention = entry[2]
                self._last[place] = (*entry[:2], (relevant, held_all(args), annots, intention), *entry[3:])

    def last_rejected(self) -> Sequence[tuple[Any, Any]]:
        """Return the plans that were tried in vain for the last event, as `Decision.rejected` holds them."""
        self.settle()
        last = self._last[-1] if self._last else None
        return () if type(last) is not tuple else Decision(*last).rejected or ()

    def select_in_order(self, mind: MindState, trail: Trail, event: Event) -> Frame | None:
        """Find the plan for an event among the relevant ones, and note how; no plan is nested."""
        relevant, args, annots, intention = event
        if self.large_lists != LargeLists.made:
            self.let_go()
        frame = plan = rejected = None
        mark, shown = len(trail), args
        for term in args:
            if type(term) is not float and type(term) is not str and not (type(term) is Literal and term.ground):
                shown = held_all(args)
                break
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
        except Exception as error:  # an internal action may raise anything; it must not end the mind
            undo(trail, mark)
            return self._select_after(trail, event, plan, rejected or [], error)
        if frame is None or shown is not args or len(trail) > mark:
            self.decided(event, shown, rejected, frame, len(trail) > mark)
            return frame
        if annots is not SELF and not (len(annots) == 1 and type(annots[0]) is Literal and annots[0].ground):
            annots = held_all(annots)
        if intention is not None:
            stack = intention.stack
            below = stack[-1] if stack else None
            self.note((mind.cycle, mind.now, event, below, intention.last, rejected, frame, annots))
        else:
            begun, origin = mind.intention_count + 1, self.origin_of(event)
            self.note((mind.cycle, mind.now, event, None, None, rejected, frame, annots, begun, origin))
        return frame

    def select(self, mind: MindState, trail: Trail, event: Event) -> Frame | None:
        """Find the plan for an event as `agentd.mind.plans.nested_plans.select`, and note how."""
        mind.plans.taken = event
        try:
            return self._select(trail, event, candidates(mind, event[0], event[3]), [])
        finally:
            mind.plans.taken = None

    def _select_after(
        self, trail: Trail, event: Event, broken: Any, rejected: list[tuple[Any, Any]], error: Exception
    ) -> Frame | None:
        """Go on after a plan whose context could not be computed, and note it all."""
        plans = event[0].plans
        others = [(plan, None) for plan in plans[plans.index(broken) + 1 :]]
        return self._select(trail, event, others, [*rejected, self._broken(event, broken, error)])

    def _select(
        self, trail: Trail, event: Event, plans: Iterable[tuple[Plan, Frame | None]], rejected: list[Any]
    ) -> Frame | None:
        relevant, args, annots, _ = event
        mind, shown, mark = self._mind, held_all(args), len(trail)
        frame: Frame | None = None
        for plan, around in plans:
            try:
                found = plan.trace(mind, trail, relevant, args, annots, around)
            except Exception as error:
                found = self._broken(event, plan, error)[1]
            if type(found) is list:
                frame = found
                break
            undo(trail, mark)
            rejected.append((plan, found))
        self.decided(event, shown, rejected or None, frame, len(trail) > mark)
        return frame

    def _broken(self, event: Event, plan: Plan, error: Exception) -> tuple[Any, Exception]:
        """Log that the context of a plan could not be computed; an internal action may raise anything."""
        context_failed(self._mind, event[0], plan, error)
        return plan, error.with_traceback(None)

    def decided(self, event: Event, args: tuple[Term, ...], rejected: Any, frame: Frame | None, bound: bool) -> None:
        """Note a decision; ``args`` are the arguments before, ``bound`` is whether selection bound variables."""
        if self.large_lists != LargeLists.made:
            self.let_go()
        mind = self._mind
        relevant, given, annots, intention = event
        if annots is not SELF and annots is not PERCEPT:
            annots = held_all(annots)
        held = None
        if frame is not None and (bound or args is not given):
            held = held_all(tuple(frame[VARIABLES:]))
        if intention is not None:
            stack = intention.stack
            below = stack[-1] if stack else None
            self.note(
                (mind.cycle, mind.now, event, below, intention.last, rejected, frame, annots, 0, None, args, held)
            )
            return
        if frame is None and rejected is None and not relevant.goal:
            return  # a belief that no plan is for
        begun = 0 if frame is None else mind.intention_count + 1
        origin = self.origin_of(event)
        self.note((mind.cycle, mind.now, event, None, None, rejected, frame, annots, begun, origin, args, held))

    def failed(
        self, intention: Intention | None, failed: Failed, frames: Sequence[Frame], handler: Relevant | None
    ) -> None:
        """Note a failure: see `Failure`."""
        mind = self._mind
        failed.__traceback__ = failed.__context__ = None  # they would keep the objects of the failed call alive
        number = 0 if intention is None else intention.id
        record = Failure(mind.cycle, mind.now, number, held(failed.code), failed, tuple(frames), handler)
        self.note(record)

    def dropped(self, frames: Sequence[Frame]) -> None:
        """Note the frames of plans that were dropped, the innermost last, and the formula that has done it."""
        current = self._mind.current
        by = None if current is None else current.last
        name = getattr(getattr(by, "syntax", None), "term", None)
        if not getattr(name, "name", "").startswith(_DROPPING):
            by = None  # a goal condition, or an operator
        self._dropped.extend((frame, by) for frame in frames[-MOST_FRAMES:])

    def dropped_by(self, frame: Frame) -> tuple[bool, Step | None]:
        """Return whether a plan was dropped, and the formula that has done it, as far as both are remembered."""
        return next(((True, by) for dropped, by in self._dropped if dropped is frame), (False, None))

    def _noting(self, where: list[Any] | deque[Any]) -> Callable[[Any], None]:
        """Return the function that notes a record there and passes it to the listener."""
        listener = self._listener
        if listener is None:
            return where.append

        def note(entry: Any) -> None:
            where.append(entry)
            listener(record_of(entry))

        return note

    def posted(self, event: Event) -> None:
        """Note the origin of an event that has just been queued and starts an intention of its own."""
        relevant, _, annots, _ = event
        if annots is PERCEPT:
            return
        mind = self._mind
        events = mind.events
        origin: Origin | None = None
        if self._given_in == mind.cycle:
            last = self._given[-1]
            if type(last) is Mail and type(last.content) is Literal and last.content.sig is relevant.sig:
                origin = (last, 0, None)
        if origin is None:
            origin = self._origin(relevant, annots)
            if origin is None:
                return
        if len(self._origins) > 2 * len(events) + 100:
            waiting = set(map(id, events))
            self._origins = {key: entry for key, entry in self._origins.items() if key in waiting}
        self._origins[id(event)] = (event, origin)

    def origin_of(self, event: Event) -> Origin | None:
        """Return the origin of an event that starts an intention; called once, when the event is taken."""
        entry = self._origins.pop(id(event), None)
        return None if entry is None else entry[1]

    def _origin(self, relevant: Relevant, annots: tuple[Any, ...]) -> Origin | None:
        mind = self._mind
        if self._given_in == mind.cycle:
            for item in self._given:
                if _raises(item, relevant.sig):
                    return item, 0, None
        if annots is SELF or (SOURCE_SELF in annots and relevant.operator != "^"):
            current = mind.current
            return (None, 0, None) if current is None else (None, current.id, current.last)
        return None  # a percept, a timer, the state of a goal

    def given(self, cycle: int, item: Input) -> None:
        """Note an input of this cycle that may raise events."""
        if isinstance(item, _Raising):
            if self._given_in != cycle:
                self._given.clear()
                self._given_in = cycle
            self._given.append(item)


_DROPPING: Final = (".drop_", ".succeed_goal", ".fail_goal")
"""How internal actions are called that drop plans."""


def _raises(item: Any, sig: Signature) -> bool:
    """Return whether an event of this signature can come from an input."""
    if type(item) is not Mail:
        return bool(item.literal.sig is sig)
    content = deref(item.content)
    if type(content) is Literal:
        return content.sig is sig or sig is _KQML
    return sig is _KQML or any(type(deref(c)) is Literal and deref(c).sig is sig for c in elements(content))
