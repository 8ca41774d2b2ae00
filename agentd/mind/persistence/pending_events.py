"""Pending events: those that a restarted mind must be given again.

An intention is represented by its *root*, the event of its outermost plan; an event without a waiting intention by
itself. The `Origin` of an event decides about it at a restart. It follows from the sources among the annotations; only
exceptions are noted, when an event begins an intention.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum
from typing import Any, Final, NamedTuple

from agentd.language.terms.format import text
from agentd.language.terms.source_annotations import SELF, SOURCE_PERCEPT, SOURCE_SELF, is_source
from agentd.language.terms.terms import Literal, Term, atom
from agentd.mind.beliefs.term_copy import detach
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import ANNOTS, ARGS, PLAN, RELEVANT, STEP, Event, Intention
from agentd.mind.execution.messages import AnsweringPlan
from agentd.mind.persistence.rows import PendingKey
from agentd.mind.persistence.term_codec import BadBytes, terms_from_bytes, terms_to_bytes
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.state import MindState

_MOST_NOTED: Final = 4096
"""Roots noted between two looks before those of ended intentions are removed."""


class Origin(IntEnum):
    """The origin of an event."""

    NEVER = 0
    """Not raised again: initial goals and beliefs, percepts (they are perceived again), states of goals (``^!g``)."""
    OWN = 1
    """The mind itself: ``!!g``, ``++b``, ``.signal``, messages to itself."""
    OTHERS = 2
    """Another agent: a message, or a consequence of one."""


class Pending(NamedTuple):
    """An event that is to be given again."""

    origin: Origin
    operator: str
    """``+`` or ``-``."""
    goal: str
    """``!``, ``?`` or nothing."""
    literal: Literal
    place: PendingKey
    """0 and the number of its intention, or 1 and its place among all queued events: they are given again in order."""

    def __str__(self) -> str:
        return f"{self.operator}{self.goal}{text(self.literal)}"

    def to_bytes(self) -> bytes:
        """Return the event as bytes. Raises CannotKeep."""
        return terms_to_bytes([self.operator, self.goal, self.literal])

    @staticmethod
    def from_bytes(place: PendingKey, origin: Origin, data: bytes) -> Pending:
        """Return the event that was encoded. Raises BadBytes."""
        match terms_from_bytes(data):
            case [str() as operator, str() as goal, Literal() as literal]:
                return Pending(origin, operator, goal, literal, place)
        raise BadBytes("no event")


def written(relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]) -> str:
    """Return an event as it is written."""
    return f"{relevant.text}{text(Literal(relevant.sig, args, annots))}"


class _Root(NamedTuple):
    """The origin of an intention."""

    origin: Origin
    seen: tuple[Any, ...]
    """The arguments of its event, whose variables the plan may have bound since."""
    args: tuple[Any, ...]
    """The same as they were."""


class Origins:
    """Tracks the origins of a mind's events and intentions."""

    def __init__(self, mind: MindState, places: int) -> None:
        """``places`` in the queue were given before, in a former life."""
        self._mind = mind
        self._marked: dict[int, tuple[Event, Origin]] = {}
        """Queued events whose origin does not follow from their annotations, by identity."""
        self._roots: dict[int, _Root] = {}
        """By the number of the intention; one without is never given again. Branches of a fork are such: their parent
        has one."""
        self._most = _MOST_NOTED
        self._queued: dict[int, tuple[Event, int]] = {}
        """The events seen in the queue, by their identity, with their places."""
        self._places = places
        self._taken: Event | None = None
        """The event that a plan is being selected for."""
        self._origin, self._began = Origin.NEVER, 0
        """Its origin, and how many intentions there were before."""
        self._args: tuple[Any, ...] = ()
        """Its arguments as they were, for an event that may be given again."""

    def mark(self, event: Event, origin: Origin) -> None:
        """Note the origin of a queued event."""
        self._marked[id(event)] = (event, origin)

    def take(self, event: Event) -> None:
        """Note an event that is to get a plan."""
        self._taken = event
        if event[3] is None:
            marked = self._marked.pop(id(event), None)
            self._origin = origin = self._by_source(event) if marked is None else marked[1]
            self._began = self._mind.intention_count
            self._args = detach(event[1]) if origin else event[1]

    def taken(self, event: Event) -> None:
        """Note the origin of the intention that an event has begun, if it has."""
        self._taken = None
        if event[3] is not None:
            return
        mind, origin = self._mind, self._origin
        if mind.intention_count != self._began:
            if origin:
                if len(self._roots) >= self._most:
                    self._prune()
                self._roots[self._began + 1] = _Root(origin, event[1], self._args)
        elif mind.events and event[0].goal:
            follows = mind.events[-1]
            if follows[3] is None and follows[0].operator == "-" and follows[0].sig is event[0].sig:
                self.mark(follows, origin)  # no plan was applicable: its failure plan is asked

    def in_hand(self) -> str:
        """Return the event that the mind works at, or that of its running intention's outermost plan; for people.

        It may be called by another thread while the mind runs.
        """
        event = self._taken
        intention = self._mind.current if event is None else event[3]
        if intention is not None and intention.stack:
            frame, root = intention.stack[0], self._roots.get(intention.id)
            args = root.args if root is not None and frame[ARGS] is root.seen else frame[ARGS]
            return written(frame[RELEVANT], args, frame[ANNOTS])
        return "" if event is None else written(*event[:3])

    def drop(self, text_of_event: str) -> int:
        """Take the queued events that are written so out of the queue; return how many."""
        events = self._mind.events
        left = [event for event in events if event[3] is not None or written(*event[:3]) != text_of_event]
        dropped = len(events) - len(left)
        if dropped:
            events.clear()
            events.extend(left)
        return dropped

    def _by_source(self, event: Event) -> Origin:
        relevant, _, annots, _ = event
        if annots is SELF:
            return Origin.OWN if relevant.operator != "^" else Origin.NEVER
        if not annots and relevant is self._mind.plans.kqml:
            return Origin.OTHERS
        if relevant.operator == "^":
            return Origin.NEVER
        sources = [a for a in annots if is_source(a)]
        if any(a not in (SOURCE_SELF, SOURCE_PERCEPT) for a in sources):
            return Origin.OTHERS
        return Origin.NEVER if SOURCE_PERCEPT in sources else Origin.OWN

    def _prune(self) -> list[Intention]:
        """Forget the roots of intentions that have ended. Return those that live."""
        roots, living = self._roots, self._mind.all_intentions()
        self._roots = {each.id: roots[each.id] for each in living if each.id in roots}
        self._most = max(_MOST_NOTED, 2 * len(self._roots))
        return living

    def pending(self) -> Iterator[tuple[PendingKey, Origin, tuple[Any, ...]]]:
        """Yield the pending events: place and origin, and the event as relevant plans, arguments and annotations."""
        mind = self._mind
        waiting: dict[int, Event] = {}
        events = mind.all_events()
        for event in events:
            if event[3] is not None:
                waiting.setdefault(event[3].id, event)
        for intention in self._prune():
            origin, found = self._root(intention, waiting.get(intention.id))
            if origin:
                yield (0, intention.id), origin, found
        queued, self._queued = self._queued, {}
        for event in events:
            if event[3] is not None:
                continue
            marked = self._marked.get(id(event))
            origin = self._by_source(event) if marked is None else marked[1]
            if not origin:
                continue
            known = queued.get(id(event))
            if known is None:
                self._places += 1
                known = (event, self._places)
            self._queued[id(event)] = known
            yield (1, known[1]), origin, event[:3]

    def _root(self, intention: Intention, event: Event | None) -> tuple[Origin, tuple[Any, ...]]:
        """Return the origin of an intention, and the event that its plans answer."""
        stack = intention.stack
        if stack and type(stack[0][PLAN]) is AnsweringPlan:
            return Origin.OTHERS, self._arrival(intention, stack[0][PLAN].mail)
        root = self._roots.get(intention.id)
        if root is None:
            return Origin.NEVER, ()
        if event is not None and (not stack or _gives_way(stack, event)):
            return root.origin, event[:3]
        if not stack:
            return Origin.NEVER, ()
        frame = stack[0]
        args = root.args if frame[ARGS] is root.seen else frame[ARGS]
        return root.origin, (frame[RELEVANT], args, frame[ANNOTS])

    def _arrival(self, intention: Intention, mail: Mail) -> tuple[Any, ...]:
        """Return the question that an intention answers, as the event of its message: any mind handles that."""
        root = self._roots.get(intention.id)
        if root is None:
            args = (atom(mail.sender), atom(mail.performative), mail.content, mail.msg_id)
            root = self._roots[intention.id] = _Root(Origin.OTHERS, args, args)
        return self._mind.plans.kqml, root.args, ()


def _gives_way(stack: list[Any], event: Event) -> bool:
    """Return whether the only plan of an intention has ended but for a goal of its own kind, which takes its place."""
    frame = stack[0]
    return len(stack) == 1 and frame[STEP] is None and frame[RELEVANT].tail is event[0].call and not frame[PLAN].special
