"""The Zenoh driver: a robot that publishes, listens and answers on Zenoh keys, on the bridge's own session."""

from __future__ import annotations

import asyncio
import json
import math
from collections import Counter
from collections.abc import Callable, Coroutine, Mapping
from contextlib import aclosing
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

from bridged.drivers.api import Execution, OnReading, Outcome, Reading, Setup, Value
from bridged.drivers.simple import SimpleDriver
from bridged.drivers.zenoh.payload_codecs import CODECS, DEFAULT, BadPayload, codec_for, payload_of
from commd.bus.raw import LARGEST, Querier, RawBus, Sample, Subscription
from commd.common.clock import Clock
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note

DISCOVERY = 1.0
"""Wall seconds in which a subscriber or server must be seen: declarations take time after a start or a reconnect."""
LOOK_EVERY = 0.02
MORE_REPLIES = 0.5
"""Wall seconds after a good reply in which another one may still fail, unless the query has ended."""
TURN = 1.0
"""Wall seconds between two signs of life to the watchdog."""


class _Closable(Protocol):
    def close(self) -> None: ...


class ZenohDriver(SimpleDriver):
    """A robot on Zenoh. It knows no orders itself: the manifest's `orders` are actions."""

    def __init__(self, setup: Setup) -> None:
        """Raises ValueError without a bus."""
        if setup.bus is None:
            raise ValueError("the driver `zenoh` needs a bus")
        super().__init__(setup)
        self._bus, self._clock = setup.bus, setup.clock
        self._key = partial(setup.robot.source, "zenoh")
        self._codec = CODECS[DEFAULT]
        self._topics: dict[tuple[str, bool], Topic] = {}
        """By the key as the manifest names it, and whether it is latched."""
        self._services: dict[str, Querier] = {}
        self._tasks: dict[Execution, asyncio.Task[None]] = {}
        self._counts = Counter(puts=0, asked=0, unheard=0)
        self._sources = Sources(self._bus.raw, setup.clock, setup.on_reading, self._key)
        self.adopt(setup.manifest)

    async def run(self) -> None:
        """Wait until cancelled; samples come by themselves."""
        try:
            while True:
                self.setup.on_turn()
                await asyncio.sleep(TURN)
        finally:
            for task in self._tasks.values():
                task.cancel()
            self._sources.close()
            declared: list[_Closable] = [*self._topics.values(), *self._services.values()]
            for one in declared:
                one.close()

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest: declare what it names, and undeclare the rest."""
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
        """Begin to put or to ask; a key with subscribers is put immediately."""
        try:
            payload = self._codec.encode(payload_of(entry, arguments))
        except ValueError as error:
            return Execution(name, Outcome("refused", str(error)))
        execution = Execution(name)
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
        """Whether a sample came lately; for a robot without percepts, whether anybody subscribes or serves."""
        if self._sources.by_name:
            return self.silence <= self.manifest.robot.link_loss
        return any(topic.heard for topic in self._topics.values()) or any(
            querier.matching for querier in self._services.values()
        )

    @property
    def silence(self) -> float:
        """Wall seconds since the last sample."""
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
        """Return silent keys, and keys with unreadable samples."""
        now = self._clock.wall()
        notes = (source.note(now) for source in self._sources.by_name.values())
        return [note for note in notes if note is not None]

    def _begin(self, execution: Execution, work: Callable[[], Coroutine[Any, Any, Outcome]]) -> None:
        async def carry_out() -> None:
            try:
                outcome = await work()
            except Exception as error:  # an action must not run for ever for a defect
                what = {"message": f"carrying out {execution.name}", "exception": error}
                asyncio.get_running_loop().call_exception_handler(what)
                outcome = Outcome("failed", f"defect in the driver: {type(error).__name__}: {error}")
            self._tasks.pop(execution, None)
            execution.end(outcome)

        self._tasks[execution] = asyncio.create_task(carry_out())

    def _put(self, topic: Topic, payload: bytes) -> Outcome:
        try:
            topic.put(payload, self._codec.encoding)
        except OSError as error:
            return Outcome("failed", f"{topic.key}: {error}")
        self._counts["puts"] += 1
        return Outcome("succeeded")

    async def _put_when_heard(self, execution: Execution, entry: ActionEntry, topic: Topic, payload: bytes) -> Outcome:
        execution.waits_for = f"a subscriber of {topic.key}"
        if not await self._seen(lambda: topic.heard, entry):
            return self._nobody(f"nobody subscribes to {topic.key}")
        return self._put(topic, payload)

    async def _ask(self, execution: Execution, entry: ActionEntry, querier: Querier, payload: bytes) -> Outcome:
        """Query all that serve a key: the first failure decides, otherwise all must succeed."""
        name = entry.service
        key = self._key(name)
        execution.waits_for = f"a server of {key}"
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
                    outcome, fields = read_reply(key, reply, self.manifest.robot.payload or DEFAULT)
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
        """Whether a peer is seen within `DISCOVERY`, and well before the deadline."""
        loop = asyncio.get_running_loop()
        until = loop.time() + min(DISCOVERY, self._clock.to_wall(entry.deadline) / 2)
        while not look():
            if loop.time() >= until:
                return False
            await asyncio.sleep(LOOK_EVERY)
        return True

    def _nobody(self, reason: str) -> Outcome:
        self._counts["unheard"] += 1
        away = "" if self._bus.router_up else ": the router is away"
        return Outcome("failed", reason + away)


def _renew(declared: dict[Any, Any], wanted: set[Any], declare: Callable[[Any], _Closable]) -> None:
    """Declare what is wanted and not there, close what is there and not wanted."""
    for name in declared.keys() - wanted:
        declared.pop(name).close()
    for name in wanted - declared.keys():
        declared[name] = declare(name)


class Topic:
    """A key to put to."""

    def __init__(self, raw: RawBus, key: str, *, latch: bool) -> None:
        """With `latch` the last value answers queries on the key."""
        self.key = key
        self._publisher = raw.publisher(key)
        self._last: Sample | None = None
        self._queryable = raw.serve(key, lambda _: self._last) if latch else None

    @property
    def heard(self) -> bool:
        """Whether there are subscribers."""
        return self._publisher.matching

    def put(self, payload: bytes, encoding: str) -> None:
        """Send to all subscribers. Raises OSError."""
        self._publisher.put(payload, encoding)
        self._last = Sample(self.key, payload, encoding)

    def close(self) -> None:
        """Undeclare the key."""
        self._publisher.close()
        if self._queryable is not None:
            self._queryable.close()


DONE = ("success", "ok")
"""Boolean fields of a reply: success."""
RESULT = "result"
"""A field of a reply that is a number, 0 for success, or a boolean."""
WHY = ("message", "reason", "error")
"""Fields of a reply with the reason of a failure."""
_WORDS = 200
"""Characters of a reply that are shown."""


def read_reply(key: str, reply: Sample, payload: str) -> tuple[Outcome, Mapping[str, object]]:
    """Return the outcome by one reply of a service, and the reply's fields.

    `payload` is the format if its Encoding does not name one.
    """
    if reply.error:
        error = reply.payload.decode(errors="replace").strip()[:_WORDS]
        return Outcome("failed", f"{key}: {error or 'an error without words'}"), {}
    try:
        fields = codec_for(reply.encoding, payload).decode(reply.payload)
    except BadPayload as bad:
        return Outcome("failed", f"{key}: its reply cannot be read: {bad}"), {}
    if not _refuses(fields):
        return Outcome("succeeded"), fields
    found = [text for name in WHY if isinstance(text := fields.get(name), str) and text]
    why = found[0] if found else json.dumps(fields, default=str)
    return Outcome("failed", f"{key}: {why[:_WORDS]}"), fields


def _refuses(fields: Mapping[str, object]) -> bool:
    """Whether a reply is a failure; `success` and `ok` count before `result`."""
    results = [done for name in DONE if isinstance(done := fields.get(name), bool)]
    if results:
        return not all(results)
    result = fields.get(RESULT)
    if isinstance(result, bool):
        return not result
    return isinstance(result, int | float) and result != 0


PATIENCE = 5.0
"""Wall seconds without a sample after which a key is a warning."""


@dataclass
class Source:
    """One key that is subscribed to."""

    key: str
    """With the robot's prefix."""
    since: float
    """When it was subscribed to; wall seconds."""
    ttl: float | None
    """Wall seconds of silence after which its percepts expire; None = it may be silent."""
    heard: float = -math.inf
    """When the last sample came; wall seconds."""
    samples: int = 0
    unreadable: int = 0
    problem: str = ""
    """The error of the first unreadable sample."""
    subscription: Subscription | None = field(default=None, repr=False)

    def note(self, now: float) -> Note | None:
        """Return what is wrong with it at `now` (wall seconds); None if all is well."""
        if self.unreadable:
            many = f"{self.unreadable} of {self.samples} samples cannot be read"
            text = f"{self.key}: {many}, the first: {self.problem}"
            return Note("samples_unreadable", text, self.key, self.unreadable)
        too_large = 0 if self.subscription is None else self.subscription.too_large
        if too_large:
            text = f"{self.key}: {too_large} samples have more than {LARGEST} bytes and are not read"
            return Note("samples_too_large", text, self.key, too_large)
        if not self.samples:
            waited = round(now - self.since)
            text = f"nothing has come on {self.key} for {waited} s since the start"
            return Note("source_never_heard", text, self.key, waited) if now - self.since > PATIENCE else None
        silence = now - self.heard
        if self.ttl is not None and silence > max(self.ttl, PATIENCE):
            return Note("source_silent", f"{self.key} has been silent for {silence:.0f} s", self.key, round(silence))
        return None


class Sources:
    """All keys of a robot's percepts."""

    def __init__(self, raw: RawBus, clock: Clock, on_reading: OnReading, key_of: Callable[[str], str]) -> None:
        """`key_of` puts the robot's prefix before a key of the manifest."""
        self._raw, self._clock, self._key_of = raw, clock, key_of
        self._on_reading = on_reading
        self._payload = DEFAULT
        self.by_name: dict[str, Source] = {}
        """By the key as the manifest names it."""
        self._past_drops = 0

    def adopt(self, manifest: Manifest) -> None:
        """Subscribe to what a manifest names, and to nothing else; a key that stays is not interrupted."""
        self._payload = manifest.robot.payload or DEFAULT
        wanted: dict[str, float | None] = {}
        for percept in manifest.percepts.values():
            shortest = [float(one) for one in (percept.ttl, wanted.get(percept.source)) if one is not None]
            wanted[percept.source] = min(shortest) if shortest else None
        for name in self.by_name.keys() - wanted.keys():
            self._drop(name)
        for name, ttl in wanted.items():
            if name not in self.by_name:
                source = Source(self._key_of(name), self._clock.wall(), ttl)
                self.by_name[name] = source
                source.subscription = self._raw.subscribe(source.key, partial(self._take, name))
            self.by_name[name].ttl = ttl

    def close(self) -> None:
        """End all subscriptions."""
        for name in list(self.by_name):
            self._drop(name)

    def answered(self, name: str, fields: Mapping[str, object]) -> None:
        """Take in a service's reply: the robot is heard, and the reply is a reading of percepts with this source."""
        if source := self.by_name.get(name):
            source.samples += 1
            source.heard = self._clock.wall()
            if fields:
                self._on_reading(Reading(name, fields))

    @property
    def heard_at(self) -> float:
        """Time of the last sample in wall seconds; minus infinity if there was none."""
        return max((source.heard for source in self.by_name.values()), default=-math.inf)

    @property
    def dropped(self) -> int:
        """Samples dropped so far because the bridge was too slow."""
        present = (source.subscription.dropped for source in self.by_name.values() if source.subscription)
        return self._past_drops + sum(present)

    def _take(self, name: str, sample: Sample) -> None:
        source = self.by_name.get(name)
        if source is None:
            return
        source.samples += 1
        source.heard = self._clock.wall()
        if sample.deleted:
            self._on_reading(Reading(name, None))
        else:
            try:
                fields = codec_for(sample.encoding, self._payload).decode(sample.payload)
            except BadPayload as bad:
                source.unreadable += 1
                source.problem = source.problem or str(bad)
                return
            self._on_reading(Reading(name, fields))

    def _drop(self, name: str) -> None:
        subscription = self.by_name.pop(name).subscription
        if subscription is not None:
            self._past_drops += subscription.dropped
            subscription.close()
