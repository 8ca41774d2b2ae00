"""Keep an agent's percept set in sync with its bridge: subscribe, fetch the present set, and fetch it again after any
gap.

The set is fetched again after a gap in the seqs, a return of the router, a restart of the bridge, and when the digest
in the bridge's health differs from ours, or is behind it (then somebody else has published in the bridge's name). Only
the bridge ages percepts. Percepts put by hand have a key of their own and are kept apart
(`commd.client.manual_percepts`).
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.client.manual_percepts import HandPercepts
from commd.common.repeated_log import is_logged
from schemas.wire import keys
from schemas.wire.percept_set import MOST_BYTES, PerceptSet, differences, key_problem, place_of, tells_of_none
from schemas.wire.records import Health, Note, Perception, Perceptions

log = logging.getLogger("percepts")

ASK_TIMEOUT = 2.0
"""Wall seconds for the bridge to reply with the present set."""
IN_FLIGHT = 2.0
"""Wall seconds after a repair in which older percepts may still arrive."""
FOLLOWS = 0.5
"""Wall seconds in which percepts may arrive that were put before a health record: it is urgent, and overtakes them."""
RETRY = 0.2
"""Wall seconds between two attempts to fetch the present set."""


class PerceptSync:
    """The percepts of one agent. `on_change` is called once for each change."""

    def __init__(
        self, bus: Bus, agent: str, robot: str, on_change: Callable[[Perception], None], inject: bool = False
    ) -> None:
        """`inject`: the mission allows percepts by hand."""
        self.percepts = PerceptSet()
        """Those of the bridge."""
        self.counters: Counter[str] = Counter()
        self._by_hand = HandPercepts(agent, inject, self.counters)
        self._bus, self._agent, self._robot, self._on_change = bus, agent, robot, on_change
        self._reported = ""
        self._doubt = asyncio.Event()
        self._waiting: list[tuple[int, asyncio.TimerHandle, Callable[[], None]]] = []
        """What waits for a percept: its seq, when that is too late, what is called."""
        self._left = ""
        """The boot of the bridge before the present one, until a repair confirms that."""
        self._repaired_at = 0.0
        """Time of the last repair, on the event loop's clock: percepts in flight then are older."""
        self._doubt.set()
        bus.subscribe(keys.percepts(bus.fleet, agent), Perceptions, self._heard)
        by_hand = keys.percept_by_hand(bus.fleet, agent, "*")
        bus.subscribe(by_hand, Perception, lambda key, one: self._tell(self._by_hand.take(key, one), self.percepts))
        bus.subscribe(keys.health(bus.fleet, robot, "bridged"), Health, self._health)
        bus.on_router(lambda up: self.doubt() if up else None)

    def present(self) -> list[Perception]:
        """Return the present percepts, those by hand last."""
        return self.percepts.present() + [
            one for one in self._by_hand.percepts.present() if not self.percepts.holds(one)
        ]

    def named(self, name: str) -> list[Perception]:
        """Return the present percepts of a name, those by hand last."""
        return self.percepts.named(name) + [
            one for one in self._by_hand.percepts.named(name) if not self.percepts.holds(one)
        ]

    def doubt(self) -> None:
        """Fetch the present set again."""
        self._doubt.set()

    def forget(self) -> None:
        """Remove the percepts of a bridge that is gone."""
        self._tell(self.percepts.clear(), self._by_hand.percepts)

    def when_seen(self, boot: str, seq: int, patience: float, then: Callable[[], None]) -> None:
        """Call `then` when the percept with this seq was applied, or after `patience` wall seconds; now if it was."""
        if self.percepts.boot != boot or self.percepts.seq >= seq:
            then()
            return

        def late() -> None:
            self._waiting.remove(waiting)
            self.counters["late"] += 1
            then()

        waiting = (seq, asyncio.get_running_loop().call_later(patience, late), then)
        self._waiting.append(waiting)

    async def run(self) -> None:
        """Repair the set whenever that is needed, for ever."""
        while True:
            await self._doubt.wait()
            self._doubt.clear()
            if not await self._repair():
                self._doubt.set()
                await asyncio.sleep(RETRY)

    async def _repair(self) -> bool:
        snapshot: list[Perception] = []

        def take(_: str, perception: Perception) -> None:
            if perception.header.source == self._robot:  # the bridge of a robot before an edited mission answers, too
                snapshot.append(perception)

        asked_at = self.percepts.seq
        everything = keys.percept(self._bus.fleet, self._agent, "**")
        try:
            errors = await self._bus.ask_all(everything, Perception, ASK_TIMEOUT, take)
        except BusClosed:
            return False
        if everything in errors:
            return False
        for key, error in errors.items():  # the others are perceived nevertheless
            self.counters["unreadable"] += 1
            log.warning("unreadable_percept key=%s %s", key, error)
        if not snapshot and len(self.percepts) and not tells_of_none(self._reported):
            return not self._bus.router_up  # nobody answered: the bridge is away, and its return starts a repair
        life = self.percepts.boot
        changes = self.percepts.restore(snapshot, asked_at)
        if changes is None:
            return False  # a newer percept arrived meanwhile
        self._repaired_at = asyncio.get_running_loop().time()
        why = ""
        if life == self.percepts.boot and self.percepts.seq < asked_at:
            why = f"its bridge is at seq {self.percepts.seq}, this set was at {asked_at}"
        elif life != self.percepts.boot == self._left:
            why = f"its bridge still runs as boot {self._left}, and a percept had boot {life}"
        self._left = ""
        if why:
            self._note("not_of_the_bridge", f"a percept in the name of {self._robot} was not of its bridge: {why}")
        self.counters["repairs"] += 1
        self._tell(changes, self._by_hand.percepts)
        self._tell_waiting()
        return True

    def _heard(self, key: str, perceptions: Perceptions) -> None:
        for perception in perceptions.changes:
            self._take(perception)
        self._tell_waiting()
        if self.percepts.in_doubt:
            self._doubt.set()

    def _take(self, perception: Perception) -> None:
        """Apply one change of the bridge's percepts."""
        if perception.header.source != self._robot:
            source = perception.header.source or "nobody"
            self._note("unreadable", f"a percept {perception.name} has source {source}, not {self._robot}")
            return
        if problem := key_problem(perception):
            self._note("unreadable", f"a percept {perception.name}: {problem}")
            return
        family = perception.name, len(perception.parameters)
        beside = self._by_hand.percepts.family(*family)
        before = self.percepts.family(*family) if beside else []
        life, left_out = self.percepts.boot, self.percepts.left_out
        if self.percepts.apply(perception):
            if life != self.percepts.boot:
                self._left = life
            if beside:  # the mind has one set: a change of the bridge's percepts is passed on belief by belief
                self._tell(differences(before, self.percepts.family(*family)), self._by_hand.percepts)
            else:
                self._on_change(perception)
        elif self.percepts.left_out > left_out:
            what = f"a percept {perception.name} is left out: those of {self._robot} take {MOST_BYTES} bytes already"
            self._note("left_out", what)
        elif asyncio.get_running_loop().time() > self._repaired_at + IN_FLIGHT:
            header, at = perception.header, self.percepts.seq
            why = f"its header has source {header.source} and seq {header.seq}, after seq {at}"
            self._note("stale", f"a percept {perception.name} changes nothing: {why}")

    def _health(self, key: str, health: Health) -> None:
        self._reported = health.percepts.get(self._agent, "")
        if (at := place_of(self._reported)) is not None:
            self.when_seen(*at, FOLLOWS, self._compare)

    def _compare(self) -> None:
        if self.percepts.needs_repair(self._reported):
            self._doubt.set()

    def notes(self) -> tuple[Note, ...]:
        """Return the notes about percepts put by hand."""
        return self._by_hand.notes()

    def _note(self, counter: str, what: str) -> None:
        """Count, and log the first ten and each thousandth."""
        self.counters[counter] += 1
        if is_logged(count := self.counters[counter]):
            log.warning("agent=%s count=%d %s", self._agent, count, what)

    def _tell(self, changes: Iterable[Perception], other: PerceptSet) -> None:
        """Pass on changes of single beliefs; a belief that the other set still has does not end."""
        for change in changes:
            if change.update != "remove" or not other.holds(change):
                self._on_change(change)

    def _tell_waiting(self) -> None:
        for waiting in [one for one in self._waiting if self.percepts.seq >= one[0]]:
            self._waiting.remove(waiting)
            _, timer, then = waiting
            timer.cancel()
            then()
