"""Run one mind on the event loop: give it a turn for each input, let it rest while it has nothing to do.

An agent with a robot has a turn for each percept. A timer for each of these rests would cost more than the percept:
there is one, and it is left running while it is due early enough.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Final, TypeAlias

import msgspec

from agentd.conversion.term_conversion import BadTerm, perceived
from agentd.language.syntax_tree.signatures import signature
from agentd.mind import Mind
from agentd.mind.data.effects import Effect
from agentd.mind.data.inputs import Input, PerceptAdded, PerceptRemoved, PerceptReplaced
from agentd.mind.execution.input_handling import heeds, heeds_percept
from commd.bus.bus import Bus
from commd.common.clock import Clock
from commd.common.tasks import Alarm, in_step
from schemas.wire.records import Perception

log = logging.getLogger("agent")

SLICE: Final = 500
"""Reasoning cycles in one slice at most; then the event loop gets a turn."""
LONGEST_SLICE: Final = 0.2
"""Wall seconds of one slice at most. An agent that reports nothing for `agent_silence` is considered hung."""
BATCH: Final = 8
"""Cycles between two readings of the clock at most. A slice begins with one: heavy work mostly stays heavy."""
BELIEVED_WITHIN: Final = 2.0
"""Wall seconds within which a percept that nothing in the mind waits for becomes a belief: it is not worth a turn."""
MANY: Final = 32
"""Unpublished decisions after which they are handed over within a slice."""
EARLY: Final = 0.0001
"""Wall seconds by which a timer may fire too early."""

_ENCODE: Final = msgspec.msgpack.Encoder().encode

Ran: TypeAlias = Callable[[int, float, list[Effect]], None]
"""Gets runs of a mind: first cycle, mission time and effects. Called for the last run of a slice, and for runs in which
the time mattered or after which many decisions are unpublished."""


def reason(mind: Mind, clock: Clock, share: int = 1, ran: Ran | None = None) -> list[Effect]:
    """Run one slice. It ends with the first cycle that has an effect, or when there is nothing left to do.

    `share` is the number of agents of this process that reason in turn, 1 or more; together they have the time of one
    slice.
    """
    until, last, batch = clock.wall() + LONGEST_SLICE / max(1, share), mind.cycle + SLICE, 1
    timers, looks = mind.timers, mind.timers.looks
    decided = () if mind.recorder is None else mind.recorder.waiting
    while True:
        before, now = mind.cycle, clock.now()
        effects = mind.run(now, min(batch, last - before))
        batch = min(2 * batch, BATCH)
        if effects or not mind.ready or mind.cycle >= last or clock.wall() >= until:
            if ran is not None:
                ran(before + 1, now, effects)
            return effects
        if timers.looks != looks or len(decided) > MANY:
            looks = timers.looks
            if ran is not None:
                ran(before + 1, now, effects)


class MindRunner:
    """Gives one mind its turns: in the pass of the event loop that brings an input, or when it is due."""

    def __init__(self, bus: Bus, mind: Mind, turn: Callable[[], float | None]) -> None:
        """`turn` reasons, and returns the wall seconds until the next turn: 0: immediately, None: at an input only."""
        self.mind = mind
        self.bad_percepts = 0
        """Percepts of which no input can be made."""
        self._bus, self._reason, self._loop = bus, turn, asyncio.get_running_loop()
        self._newest: dict[tuple[str, int], tuple[tuple[int, ...], dict[bytes, Perception]]] = {}
        """Percepts that nothing in the mind waits for: by name and arity their key, and by its values the newest."""
        self.turn_due = True
        """Whether a turn follows as soon as everything that the bus has delivered is taken in, or there is none yet."""
        self._due: float | None = None
        """Loop time of the next turn at the latest."""
        self._alarm = Alarm(self._ring)
        self._finished = False
        """Whether the present or next turn is the last one."""
        self._broken: BaseException | None = None
        """The error of the last turn."""
        self._stop = asyncio.Event()
        self._over: asyncio.Future[None] = self._loop.create_future()
        """Done after the last turn, if that was not ended by `stop`."""

    # --- inputs ---

    def perceive(self, perception: Perception) -> None:
        """Give the mind a percept; of several that nothing in it waits for, each in the place of the last, the last."""
        family, key = (perception.name, len(perception.parameters)), perception.key
        waiting = self._newest.get(family)
        if perception.update == "replace" and (
            waiting[0] == key
            if waiting is not None
            else not self.turn_due and not heeds_percept(self.mind, signature(*family))
        ):
            if waiting is None:
                waiting = self._newest[family] = key, {}
                self._turn_within(in_step(self._loop.time(), BELIEVED_WITHIN))
            waiting[1][_ENCODE([perception.parameters[place] for place in key]) if key else b""] = perception
        elif (item := self._read(perception)) is not None:
            self.feed(item)

    def _read(self, perception: Perception) -> Input | None:
        """Return a percept as an input of the mind; None, counted and logged, if it has no terms."""
        try:
            literal = perceived(perception)
        except BadTerm as bad:
            self.bad_percepts += 1
            log.warning("agent=%s bad_percept name=%s why=%s", self.mind.name, perception.name, bad)
            return None
        match perception.update:
            case "replace":
                return PerceptReplaced(literal, perception.key)
            case "add":
                return PerceptAdded(literal)
            case "remove":
                return PerceptRemoved(literal, perception.key)

    def _take_newest(self) -> None:
        newest, self._newest = self._newest, {}
        for _, perceptions in newest.values():
            for perception in perceptions.values():
                if (item := self._read(perception)) is not None:
                    self.mind.feed(item)

    def feed(self, item: Input) -> None:
        """Give the mind an input and see that it gets a turn, soon if anything in it may wait for the input."""
        if self._newest:
            self._take_newest()
        self.mind.feed(item)
        if self.turn_due:
            return
        if heeds(self.mind, item):
            self.turn_due = True
            self._bus.afterwards(self._turn)
        else:
            self._turn_within(in_step(self._loop.time(), BELIEVED_WITHIN))

    def catch_up(self) -> None:
        """Let the mind take what it was given, before others look at its beliefs."""
        if (self._newest or self.mind.inputs) and not self.turn_due:
            self._turn()

    # --- turns ---

    def wake(self) -> None:
        """See that the mind gets a turn soon."""
        if not self.turn_due:
            self.turn_due = True
            self._loop.call_soon(self._turn)

    def finish(self) -> None:
        """Let `run` end after the present or next turn."""
        self._finished = True
        self.wake()

    async def run(self, stop: asyncio.Event) -> None:
        """Give the mind turns until `stop` is set or `finish` is called. Raises what a turn raises."""
        self._stop = stop
        stopping = asyncio.create_task(stop.wait())
        try:
            self._turn()
            await asyncio.wait((stopping, self._over), return_when=asyncio.FIRST_COMPLETED)
            if self._broken is not None:
                raise self._broken
        finally:
            stopping.cancel()
            self._over.cancel()
            self._alarm.cancel()
            self.turn_due = True

    def _turn(self) -> None:
        """Take a turn, and see to the next one."""
        if self._over.done() or self._stop.is_set():
            return
        self.turn_due, self._due = False, None
        if self._newest:
            self._take_newest()
        try:
            pause = self._reason()
        except BaseException as error:
            self._broken, self._finished, pause = error, True, None
        if self._finished:
            self._over.set_result(None)
        elif pause == 0:
            self.wake()
        elif pause is not None:
            self._turn_within(pause)

    def _turn_within(self, seconds: float) -> None:
        """Take a turn in `seconds` (wall clock, 0 or more) at the latest."""
        due = self._loop.time() + seconds
        if self._due is None or due < self._due:
            self._due = due
            self._alarm.by(due)

    def _ring(self) -> None:
        if self._due is None or self.turn_due:
            return
        if self._due > self._loop.time() + EARLY:
            self._alarm.by(self._due)
        else:
            self._turn()


class LagEstimator:
    """Estimates how far a mind is behind its inputs, at no cost for its cycles.

    Each cycle takes one event or message. Of what waits at one look all has been taken that many cycles later; then the
    estimator follows what waits at that moment.
    """

    def __init__(self) -> None:
        self._until: int | None = None
        """The cycle by which the inputs of the last look are taken; None: nothing waited."""
        self._since = 0.0

    def lag(self, cycle: int, waiting: int, now: float) -> float:
        """Return the seconds for which the inputs of the last look have waited; 0 if they are taken.

        `cycle` is the number of the last one, `waiting` that of events and messages (0 or more), `now` in seconds.
        """
        if self._until is not None and cycle < self._until and waiting:
            return now - self._since
        self._until = cycle + waiting if waiting else None
        self._since = now
        return 0.0
