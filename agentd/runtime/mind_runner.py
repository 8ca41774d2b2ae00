"""Run one mind on the event loop: wake it for each input, give it turns, let it sleep while it has nothing to do.

An agent with a robot is woken for each percept. A timer for each of these sleeps would cost more than the percept:
there is one, and it is left running while it is due early enough.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Final, TypeAlias

from agentd.language.syntax_tree.signatures import signature
from agentd.mind import Mind
from agentd.mind.data.effects import Effect
from agentd.mind.data.inputs import Input
from agentd.mind.execution.input_handling import heeds, heeds_percept
from commd.bus.bus import Bus
from commd.common.alarm import Alarm
from commd.common.clock import Clock
from schemas.wire.records import Perception

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
    """Gives one mind its turns: in the pass of the event loop that brings an input, or when a timer is due."""

    def __init__(
        self, bus: Bus, mind: Mind, turn: Callable[[], float | None], read: Callable[[Perception], Input | None]
    ) -> None:
        """`turn` reasons, and returns the wall seconds until the next turn: 0: immediately, None: at an input only.

        `read` makes an input of a percept, None of one that cannot be.
        """
        self.mind = mind
        self._bus, self._reason, self._read, self._loop = bus, turn, read, asyncio.get_running_loop()
        self._timer = WakeupTimer(self._turn_now)
        self._newest: dict[tuple[str, int], Perception] = {}
        """Percepts that nothing in the mind waits for, by name and arity: a newer one takes the place of its like."""
        self._turn_due = False
        """Whether a turn follows as soon as everything that the bus has delivered is taken in."""
        self._finished = self._left = False
        """Whether `finish` was called, and whether a turn outside of `run` has seen that."""
        self._broken: BaseException | None = None
        """The error of a turn outside of `run`."""

    def perceive(self, perception: Perception) -> None:
        """Give the mind a percept; of several that nothing in it waits for, and that have one value, the last one."""
        like = perception.name, len(perception.parameters)
        one_value = perception.update == "replace" and not perception.key
        if one_value and like in self._newest:
            self._newest[like] = perception
        elif one_value and self._timer.asleep and not self._turn_due and not heeds_percept(self.mind, signature(*like)):
            self._newest[like] = perception
            self._timer.within_at_most(BELIEVED_WITHIN)
        elif (item := self._read(perception)) is not None:
            self.feed(item)

    def _take_newest(self) -> None:
        newest, self._newest = self._newest, {}
        for perception in newest.values():
            if (item := self._read(perception)) is not None:
                self.mind.feed(item)

    def feed(self, item: Input) -> None:
        """Give the mind an input and see that it gets a turn, soon if anything in it may wait for the input."""
        self._take_newest()
        self.mind.feed(item)
        if self._turn_due:
            return
        if self._timer.asleep:
            if not heeds(self.mind, item):
                self._timer.within_at_most(BELIEVED_WITHIN)
                return
            self._turn_due = True
            self._bus.afterwards(self._turn_now)
        else:
            self._timer.set()

    def catch_up(self) -> None:
        """Let the mind take what it was given, before others look at its beliefs."""
        if (self._newest or self.mind.inputs) and self._timer.asleep and not self._turn_due:
            self._turn_now()

    def wake(self) -> None:
        """See that the mind gets a turn soon."""
        self._timer.set()

    def finish(self) -> None:
        """Let `run` end after the present or next turn."""
        self._finished = True
        self._timer.set()

    async def run(self, stop: asyncio.Event) -> None:
        """Give the mind turns until `stop` is set or `finish` is called. Raises what a turn raises."""
        stopping = asyncio.create_task(stop.wait())
        stopping.add_done_callback(lambda _: self.wake())
        try:
            while not stop.is_set():
                self._timer.clear()
                pause = self._turn()
                if self._finished:
                    return
                if pause == 0:
                    await asyncio.sleep(0)
                    continue
                await self._timer.wait(pause)
                if self._broken is not None:
                    raise self._broken
                if self._left:
                    return
        finally:
            stopping.cancel()
            self._timer.close()

    def _turn(self) -> float | None:
        self._take_newest()
        return self._reason()

    def _turn_now(self) -> None:
        """Take a turn in place of the task that sleeps, in the same pass of the event loop as the input."""
        self._turn_due = False
        if not self._timer.asleep:
            self._timer.set()
            return
        self._timer.clear()
        try:
            pause = self._turn()
        except BaseException as error:
            self._broken = error
            self._timer.set()
            return
        self._left = self._finished
        if self._left:
            self._timer.set()
        elif pause == 0:
            self._turn_due = True
            self._loop.call_soon(self._turn_now)
        else:
            self._timer.within(pause)


class WakeupTimer:
    """What one task sleeps on: an event and a timer."""

    def __init__(self, ring: Callable[[], None] | None = None) -> None:
        """`ring` is called when the time is over, in place of waking the task."""
        self._loop = asyncio.get_running_loop()
        self._on_time = ring or self.set
        self._set = False
        self._sleeper: asyncio.Future[None] | None = None
        self._alarm = Alarm(self._ring)
        self._due: float | None = None
        """Loop time at which the task is to be woken at the latest."""

    @property
    def asleep(self) -> bool:
        """Whether the task sleeps, and nothing has woken it yet."""
        return self._sleeper is not None and not self._sleeper.done()

    def set(self) -> None:
        """Wake the task, or keep it from falling asleep."""
        self._set = True
        if self._sleeper is not None and not self._sleeper.done():
            self._sleeper.set_result(None)

    def clear(self) -> None:
        """Forget earlier calls of `set`."""
        self._set = False

    def within(self, seconds: float | None) -> None:
        """Wake the task in `seconds` (wall clock, 0 or more) at the latest; None: only by `set`."""
        if seconds is None:
            self._due = None
            return
        self._due = self._loop.time() + seconds
        self._alarm.by(self._due)

    def within_at_most(self, seconds: float) -> None:
        """Wake the task in `seconds` (wall clock, 0 or more) at the latest, or when it is to be woken before."""
        if self._due is None or self._due > self._loop.time() + seconds:
            self.within(seconds)

    async def wait(self, seconds: float | None) -> None:
        """Sleep until `set` is called, at most `seconds` (wall clock, 0 or more; None: no limit).

        Return immediately if it was called already.
        """
        if self._set:
            return
        self.within(seconds)
        self._sleeper = self._loop.create_future()
        try:
            await self._sleeper
        finally:
            self._sleeper = None

    def close(self) -> None:
        """Cancel the timer."""
        self._due = None
        self._alarm.cancel()

    def _ring(self) -> None:
        if self._due is None:
            return
        if self._due > self._loop.time() + EARLY:
            self._alarm.by(self._due)
            return
        self._due = None
        self._on_time()


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
