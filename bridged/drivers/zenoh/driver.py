"""The Zenoh driver: a robot that publishes, listens and answers on Zenoh keys, on the bridge's own session."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Coroutine, Mapping
from contextlib import aclosing
from functools import partial
from typing import Any, Protocol

from bridged.drivers.api import Execution, Outcome, Setup, Value
from bridged.drivers.simple import SimpleDriver
from bridged.drivers.zenoh.manifest_validation import payload_of
from bridged.drivers.zenoh.payload_codecs import CODECS, DEFAULT
from bridged.drivers.zenoh.publications import Topic
from bridged.drivers.zenoh.replies import read_reply
from bridged.drivers.zenoh.subscriptions import Sources
from commd.bus.raw import Querier
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note

DISCOVERY = 1.0
"""Wall seconds that a listener or a server may take to be seen: declarations travel after a start or a reconnect."""
LOOK_EVERY = 0.02
MORE_REPLIES = 0.5
"""Wall seconds after a good reply in which another one may still say no, if the query has not ended by then."""
TICK, TICKS = 0.25, 4.0
"""At most so many wall seconds between looks at the time, and at least so many looks in a second of the mission."""


class _Closable(Protocol):
    def close(self) -> None: ...


class ZenohDriver(SimpleDriver):
    """A robot on Zenoh. It knows no orders itself: the manifest's `orders` are actions."""

    def __init__(self, setup: Setup) -> None:
        """Raises ValueError without a bus."""
        if setup.bus is None:
            raise ValueError("the driver `zenoh` needs a bus")
        super().__init__(setup)
        self._bus, self._clock, self._on_step = setup.bus, setup.clock, setup.on_step
        self._prefix = setup.robot.prefix
        self._codec = CODECS[DEFAULT]
        self._topics: dict[tuple[str, bool], Topic] = {}
        """By the key as the manifest names it, and whether it is latched."""
        self._services: dict[str, Querier] = {}
        self._tasks: dict[Execution, asyncio.Task[None]] = {}
        self._counts = Counter(puts=0, asked=0, unheard=0)
        self._sources = Sources(self._bus.raw, setup.clock, setup.on_reading, setup.on_step, self._key)
        self.adopt(setup.manifest)

    async def run(self) -> None:
        """Let time pass until cancelled; samples come by themselves."""
        pause = min(TICK, 1 / (TICKS * self._clock.speed))
        try:
            while True:
                self._step()
                await asyncio.sleep(pause)
        finally:
            for task in self._tasks.values():
                task.cancel()
            self._sources.close()
            declared: list[_Closable] = [*self._topics.values(), *self._services.values()]
            for one in declared:
                one.close()

    def adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest: what it names is declared, what it does not name any more is taken back."""
        super().adopt(manifest)
        self._codec = CODECS[manifest.robot.payload or DEFAULT]
        self._sources.adopt(manifest)
        entries = manifest.actions.values()
        raw = self._bus.raw
        _renew(
            self._topics,
            {(entry.topic, entry.latch) for entry in entries if entry.topic},
            lambda one: Topic(raw, self._key(one[0]), latch=one[1]),
        )
        _renew(
            self._services,
            {entry.service for entry in entries if entry.service},
            lambda name: raw.querier(self._key(name)),
        )

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin to put or to ask; what somebody listens to is put at once."""
        execution = Execution(name)
        try:
            payload = self._codec.encode(payload_of(entry, arguments))
        except ValueError as error:
            execution.end(Outcome("refused", str(error)))
            return execution
        if entry.service:
            self._begin(execution, partial(self._ask, execution, entry, self._services[entry.service], payload))
            return execution
        topic = self._topics[entry.topic, entry.latch]
        if topic.heard:
            execution.end(self._put(topic, payload))
        else:
            self._begin(execution, partial(self._put_when_heard, execution, entry, topic, payload))
        return execution

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End a running execution; a query is cancelled. To hold is an action of the manifest."""
        task = self._tasks.pop(execution, None)
        if task is not None:
            task.cancel()
        execution.end(outcome)

    @property
    def heard(self) -> bool:
        """Whether something came lately; of a robot that says nothing unasked, whether anybody listens or serves."""
        if self._sources.by_name:
            return self.silence <= self.manifest.robot.link_loss
        return any(topic.heard for topic in self._topics.values()) or any(
            querier.matching for querier in self._services.values()
        )

    @property
    def silence(self) -> float:
        """Wall seconds since anything came."""
        return self._clock.wall() - self._sources.heard_at

    def counters(self) -> dict[str, float]:
        """Figures for health."""
        sources = self._sources.by_name.values()
        return {
            "samples": sum(source.samples for source in sources),
            "samples_unreadable": sum(source.unreadable for source in sources),
            "samples_dropped": self._sources.dropped,
            **self._counts,
        }

    def notes(self) -> list[Note]:
        """Return what is not heard, and what cannot be read."""
        now = self._clock.wall()
        notes = (source.note(now) for source in self._sources.by_name.values())
        return [note for note in notes if note is not None]

    def _key(self, name: str) -> str:
        return f"{self._prefix}/{name}" if self._prefix else name

    def _begin(self, execution: Execution, work: Callable[[], Coroutine[Any, Any, Outcome]]) -> None:
        async def carry_out() -> None:
            try:
                outcome = await work()
            except Exception as error:  # an action must not run for ever for a defect
                _tell_defect(f"carrying out {execution.name}", error)
                outcome = Outcome("failed", f"defect in the driver: {type(error).__name__}: {error}")
            self._tasks.pop(execution, None)
            execution.end(outcome)
            self._step()

        self._tasks[execution] = asyncio.create_task(carry_out())

    def _step(self) -> None:
        try:
            self._on_step()
        except Exception as error:  # a defect must not end the robot's driver
            _tell_defect("looking at the actions", error)

    def _put(self, topic: Topic, payload: bytes) -> Outcome:
        try:
            topic.put(payload, self._codec.encoding)
        except OSError as error:
            return Outcome("failed", f"{topic.key}: {error}")
        self._counts["puts"] += 1
        return Outcome("succeeded")

    async def _put_when_heard(self, execution: Execution, entry: ActionEntry, topic: Topic, payload: bytes) -> Outcome:
        execution.waits_for = f"somebody to listen on {topic.key}"
        if not await self._seen(lambda: topic.heard, entry):
            return self._nobody(f"nobody listens on {topic.key}")
        return self._put(topic, payload)

    async def _ask(self, execution: Execution, entry: ActionEntry, querier: Querier, payload: bytes) -> Outcome:
        """Ask all who serve a key: the first that says no decides, and otherwise all must have said yes."""
        name = entry.service
        key = self._key(name)
        execution.waits_for = f"somebody to serve {key}"
        if not await self._seen(lambda: querier.matching, entry):
            return self._nobody(f"nobody serves {key}")
        execution.waits_for = f"the reply of {key}"
        self._counts["asked"] += 1
        good: Outcome | None = None
        try:
            async with (
                asyncio.timeout(None) as patience,
                aclosing(querier.ask(payload, self._codec.encoding)) as replies,
            ):
                async for reply in replies:
                    outcome, fields = read_reply(key, reply, self._codec_name)
                    if outcome.state != "succeeded":
                        return outcome
                    self._sources.answered(name, fields)
                    if good is None:
                        good = outcome
                        patience.reschedule(asyncio.get_running_loop().time() + MORE_REPLIES)
        except TimeoutError:
            pass
        except OSError as error:
            return Outcome("failed", f"{key}: {error}")
        return good or Outcome("failed", f"{key} ended without a reply")

    async def _seen(self, look: Callable[[], bool], entry: ActionEntry) -> bool:
        """Whether somebody is seen within `DISCOVERY`, and well before the deadline."""
        loop = asyncio.get_running_loop()
        until = loop.time() + min(DISCOVERY, self._clock.to_wall(entry.deadline) / 2)
        while not look():
            if loop.time() >= until:
                return False
            await asyncio.sleep(LOOK_EVERY)
        return True

    def _nobody(self, said: str) -> Outcome:
        self._counts["unheard"] += 1
        away = "" if self._bus.router_up else ": the router is away"
        return Outcome("failed", said + away)

    @property
    def _codec_name(self) -> str:
        return self.manifest.robot.payload or DEFAULT


def _tell_defect(what: str, error: Exception) -> None:
    asyncio.get_running_loop().call_exception_handler({"message": what, "exception": error})


def _renew(declared: dict[Any, Any], wanted: set[Any], declare: Callable[[Any], _Closable]) -> None:
    """Declare what is wanted and not there, close what is there and not wanted."""
    for name in declared.keys() - wanted:
        declared.pop(name).close()
    for name in wanted - declared.keys():
        declared[name] = declare(name)
