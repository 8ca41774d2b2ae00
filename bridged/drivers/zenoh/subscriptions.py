"""Subscriptions to a robot: one for each key that a percept names, and its warnings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

from bridged.drivers.api import OnReading, Reading
from bridged.drivers.zenoh.payload_codecs import DEFAULT, BadPayload, codec_for
from commd.bus.raw import LARGEST, RawBus, Sample, Subscription
from commd.common.clock import Clock
from schemas.manifest.loader import Manifest
from schemas.wire.records import Note

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
