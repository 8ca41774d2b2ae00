"""The present percepts of a robot's agents, made of its driver's readings by the manifest (design section 4).

A percept is published when it changes, no more often than its rate, and removed when its source is silent for its
`ttl`. Pure but for the clock: readings go in, perceptions come out.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import msgspec

from bridged.drivers.api import Reading
from bridged.paper_format.text_values import percept_value
from commd.common.clock import Clock
from schemas.humanize import shortened
from schemas.manifest.loader import Field, Manifest, PerceptEntry
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import Header, Note, Perception
from schemas.wire.terms import Atom, Term, to_float

MAX_BELIEFS = 1000
"""Beliefs that a robot may give at a time; the oldest of the name that has most of them goes first, and is counted: a
vehicle that sends a thousand parameters keeps its position."""
MAX_SOURCES = 256
"""Sources whose last reading is kept."""
JITTER = 0.25
"""Part of the period by which a change may come too soon or too late and count as on time: a 10 Hz source must not be
halved by its jitter. On average the rate is kept."""
STEADY = 0.9
"""Part of the period between two readings that shows a source to be no faster than the rate: the second one is not held
back although the first was late."""
DIGITS = 12
"""Significant digits kept after a conversion: -276036830 * 1e-7 is -27.603683 and nothing beyond."""
LARGEST = 65_536
"""Bytes of the largest belief that is published; an agent must be able to take in each of them."""
_LISTS, _NUMBERS = (list, tuple), (int, float)
"""Made once: a union written in a function is built for each value of each reading."""
_ENCODE = msgspec.msgpack.Encoder().encode

Parameters = tuple[Term, ...]
Update = Literal["replace", "add", "remove"]
Publish = Callable[[str, Perception], None]
"""Called with an agent and a change of its percepts."""
ToTerm = Callable[[object], Term]
"""Makes a term of a plain value, as the robot's `values` say."""
Reader = Callable[[Mapping[str, object]], Term]
"""Makes an argument of the fields of a reading."""
Source = tuple[str, str]
"""A driver (empty: the robot's own) and its source."""


@dataclass(slots=True)
class _Slot:
    """One belief that holds."""

    name: str
    entry: PerceptEntry
    published: Parameters
    due: float
    """When the next change may be published, in mission seconds."""
    heard_at: float
    period: float
    """Mission seconds between two changes at the entry's rate."""
    waiting: Parameters | None = None
    """The newest value, held back by the rate."""


@dataclass(slots=True)
class _Misread:
    """The readings of a source since the first one of which no belief could be made."""

    problem: str
    """The belief and the reason of the first one."""
    readings: int = 0
    unreadable: int = 0


class PerceptPublisher:
    """The present percepts of one robot, and one numbered stream of changes for each of its agents."""

    def __init__(
        self,
        manifest: Manifest,
        agents: Iterable[str],
        publish: Publish,
        *,
        robot: str,
        boot: str,
        clock: Clock,
        wake: asyncio.Event | None = None,
    ) -> None:
        """`wake` is set when a tick is due before `next_tick`: a change is held back, or may be for less long."""
        self.expired = 0
        """Beliefs removed so far because their source fell silent."""
        self.dropped = 0
        """Beliefs removed so far because there were too many."""
        self.unreadable = 0
        """Readings so far that lacked a field which the manifest names, or had one of which no term can be made."""
        self.next_tick = math.inf
        """When `tick` is called at the latest, in mission seconds; its caller may set it."""
        self.sets = {agent: PerceptSet() for agent in agents}
        self._publish = publish
        self._robot, self._boot, self._clock, self._wake = robot, boot, clock, wake or asyncio.Event()
        self._ttl_scale = max(1.0, clock.speed)
        self._slots: dict[tuple[object, ...], _Slot] = {}
        self._last: dict[Source, tuple[Reading, float]] = {}
        """The last reading of each source and when it came: some sources say a thing once."""
        self._use(manifest)

    def _use(self, manifest: Manifest) -> None:
        self._percepts = manifest.percepts
        self._term: ToTerm = percept_value if manifest.robot.values == "text" else _term
        self._by_source: dict[Source, list[tuple[str, PerceptEntry, tuple[Reader, ...]]]] = {}
        self._misread: dict[Source, _Misread] = {}
        self._own = own = manifest.robot.driver
        for name, entry in manifest.percepts.items():
            source = ("" if entry.driver == own else entry.driver, entry.source)
            readers = tuple(_reader(field, self._term) for field in entry.fields())
            self._by_source.setdefault(source, []).append((name, entry, readers))

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest: unchanged percepts are untouched, those it does not declare are withdrawn.

        A percept that is declared differently keeps its belief until the next reading, unless that would be another
        belief: of another source, number of arguments or identity. That one, and a new one, is made of the last
        reading of its source.
        """
        old, new = self._percepts, manifest.percepts
        made = set()
        for name, entry in new.items():
            before = old.get(name, entry)
            other = name not in old or _identity(entry, manifest) != _identity(before, manifest)
            if other and "add" not in (entry.buf, before.buf):  # an event is over
                made.add(name)
        for key, slot in list(self._slots.items()):
            if slot.name not in old:
                continue
            now_declared = new.get(slot.name)
            if now_declared is None or _identity(now_declared, manifest) != _identity(slot.entry, manifest):
                self._remove(key)
            else:
                slot.due += _period(now_declared) - slot.period
                slot.entry, slot.period = now_declared, _period(now_declared)
                if slot.waiting is not None:
                    self._wake.set()
        self._use(manifest)
        for reading, at in list(self._last.values()):
            self.take(reading, at, made)

    def take(self, reading: Reading, at: float | None = None, only: Collection[str] | None = None) -> None:
        """Take in a reading of a driver, which came now or `at` a mission time: make its percepts, or `only` those."""
        now, source = self._clock.now() if at is None else at, (reading.driver, reading.source)
        if reading.fields is None:
            self._last.pop(source, None)
        elif source in self._last or len(self._last) < MAX_SOURCES:
            self._last[source] = (reading, now)
        misread: tuple[str, PerceptEntry, Exception] | None = None
        for name, entry, readers in self._by_source.get(source, ()):
            if only is not None and name not in only:
                continue
            if reading.fields is None:
                self._withdraw(name)
                continue
            try:
                parameters = tuple([read(reading.fields) for read in readers])
                if len(_ENCODE(parameters)) > LARGEST:
                    raise ValueError("too large to be published")
            except _Absent:
                if entry.buf == "update" and not entry.key:  # which of several it was is not known
                    self._withdraw(name)
            except _UNUSABLE as error:
                misread = misread or (name, entry, error)
            else:
                self._believe(name, entry, parameters, now)
        if misread:
            self.unreadable += 1
            if source not in self._misread:
                name, entry, why = misread
                self._misread[source] = _Misread(f"`{name}`, the first: {_reason(entry, why, reading.fields)}")
            self._misread[source].unreadable += 1
        if source in self._misread:
            self._misread[source].readings += 1

    def notes(self, name_of: Callable[[str, str], str]) -> list[Note]:
        """Return the sources of which no belief can be made, each with its name of a driver and source."""
        notes = []
        for (driver, source), found in self._misread.items():
            about = name_of(driver or self._own, source)
            text = f"{about}: {found.unreadable} of the last {found.readings} readings make no belief {found.problem}"
            notes.append(Note("percepts_unreadable", text, about, found.unreadable))
        return notes

    def tick(self) -> float:
        """Publish what the rate held back and is due, and remove what has aged.

        Returns the mission seconds until more of it is due; infinite if nothing is held back or ages.
        """
        now, due = self._clock.now(), math.inf
        for key, slot in list(self._slots.items()):
            if slot.waiting is not None and now >= slot.due:
                self._publish_slot(slot, slot.waiting, now)
            if slot.waiting is not None:
                due = min(due, slot.due)
            ttl = slot.entry.ttl
            if ttl is None:
                continue
            if now - slot.heard_at > ttl * self._ttl_scale:
                self.expired += 1
                self._remove(key)
            else:
                due = min(due, slot.heard_at + ttl * self._ttl_scale)
        return due - now

    def flush(self) -> None:
        """Publish everything that is held back: a status must not refer to percepts that come after it."""
        now = self._clock.now()
        for slot in self._slots.values():
            if slot.waiting is not None:
                self._publish_slot(slot, slot.waiting, now)

    def show(self, agent: str, name: str, parameters: Parameters, key: tuple[int, ...] = ()) -> None:
        """Publish a percept of one agent alone (about its action, or about it), if it has changed.

        `key`: places of the parameters, from 0, that identify it.
        """
        if all(one.parameters != parameters for one in self.sets[agent].named(name)):
            self._send((agent,), name, parameters, "replace", key)

    def show_all(self, name: str, parameters: Parameters | None) -> None:
        """Publish a percept of every agent, if it has changed; None: none of them has one of this name."""
        for agent in self.sets:
            if parameters is None:
                self.withdraw(agent, name)
            else:
                self.show(agent, name, parameters)

    def withdraw(self, agent: str, name: str, first: Parameters = ()) -> None:
        """Remove the percepts that were shown to one agent under a name and begin with these arguments."""
        for one in self.sets[agent].named(name):
            if one.parameters[: len(first)] == first:
                self._send((agent,), name, one.parameters, "remove", tuple(range(len(one.parameters))))

    def _believe(self, name: str, entry: PerceptEntry, parameters: Parameters, now: float) -> None:
        if entry.buf == "add":
            key = (name, _ENCODE(parameters))
        else:
            key = (name, _ENCODE([parameters[position] for position in entry.key]) if entry.key else b"")
        slot = self._slots.get(key)
        if slot is None:
            while len(self._slots) >= MAX_BELIEFS:
                self.dropped += 1
                ((most, _),) = Counter(slot.name for slot in self._slots.values()).most_common(1)
                self._remove(next(key for key, slot in self._slots.items() if slot.name == most))
            slot = self._slots[key] = _Slot(name, entry, parameters, -math.inf, now, _period(entry))
            self._publish_slot(slot, parameters, now)
            due = math.inf if entry.ttl is None else now + entry.ttl * self._ttl_scale
        else:
            since, slot.heard_at = now - slot.heard_at, now
            if entry.buf == "update" and not _changed(entry.deadband, slot.published, parameters):
                slot.waiting = None
                return
            if entry.buf == "add" or now >= slot.due - JITTER * slot.period or since >= STEADY * slot.period:
                self._publish_slot(slot, parameters, now)
                return
            slot.waiting, due = parameters, slot.due
        if due < self.next_tick:
            self.next_tick = due
            self._wake.set()

    def _publish_slot(self, slot: _Slot, parameters: Parameters, now: float) -> None:
        slot.published, slot.waiting = parameters, None
        in_turn = -JITTER * slot.period <= now - slot.due < slot.period
        slot.due = (slot.due if in_turn else now) + slot.period  # one that came late does not hold up the next
        self._send(self.sets, slot.name, parameters, "add" if slot.entry.buf == "add" else "replace", slot.entry.key)

    def _withdraw(self, name: str) -> None:
        for key in [key for key, slot in self._slots.items() if slot.name == name]:
            self._remove(key)

    def _remove(self, key: tuple[object, ...]) -> None:
        slot = self._slots.pop(key)
        self._send(self.sets, slot.name, slot.published, "remove", tuple(range(len(slot.published))))

    def _send(
        self, agents: Iterable[str], name: str, parameters: Parameters, update: Update, key: tuple[int, ...]
    ) -> None:
        for agent in agents:
            present = self.sets[agent]
            header = Header(seq=present.seq + 1, stamp=time.time_ns(), source=self._robot, boot=self._boot)
            perception = Perception(header=header, name=name, parameters=parameters, update=update, key=key)
            present.apply(perception)
            self._publish(agent, perception)


def _identity(entry: PerceptEntry, manifest: Manifest) -> tuple[object, ...]:
    """Return what makes a percept the same one although its entry has changed."""
    return (
        manifest.driver_of(entry),
        entry.source,
        entry.arity,
        entry.key,
        entry.buf,
        *(entry.fields()[position].field for position in entry.key),
    )


def _period(entry: PerceptEntry) -> float:
    """Return the mission seconds between two changes at the entry's rate."""
    return 0.0 if entry.rate is None else 1.0 / entry.rate


def _changed(deadband: float, old: Parameters, new: Parameters) -> bool:
    """Whether one of the terms has become another one."""
    for was, becomes in zip(old, new, strict=True):
        if type(was) is float and type(becomes) is float:
            if not abs(becomes - was) <= deadband:
                return True
        elif _differs(deadband, was, becomes):
            return True
    return False


def _differs(deadband: float, old: Term, new: Term) -> bool:
    """Whether a term has become another one; a number within the deadband of the published one has not."""
    if type(old) is type(new) and old == new and not isinstance(old, list):
        return False
    if isinstance(old, list) and isinstance(new, list):
        return len(old) != len(new) or any(map(partial(_differs, deadband), old, new))
    was, becomes = to_float(old), to_float(new)
    return was is None or becomes is None or not abs(becomes - was) <= deadband


_UNUSABLE = (LookupError, ValueError, TypeError, OverflowError, RecursionError)
"""Why no term is made of a value."""


class _Absent(Exception):
    """The robot says that it does not know the value."""


def _reader(field: Field, term: ToTerm) -> Reader:
    """Return what reads a field: by its name alone where its value is a number, as most are."""
    if "." in field.field or field.each or term is not _term:
        return partial(_argument, field, term=term)
    name, absent, scale, offset = field.field, field.absent, field.scale, field.offset
    converts = (scale, offset) != (1.0, 0.0)

    def read(message: Mapping[str, object]) -> Term:
        value = message[name]
        if (type(value) is not int and type(value) is not float) or value == absent or not math.isfinite(value):
            return _argument(field, message, term)
        return _converted(value, scale, offset) if converts else value

    return read


def _reason(entry: PerceptEntry, error: Exception, fields: object) -> str:
    """Return why no belief can be made of a reading, for people."""
    if not isinstance(fields, Mapping):
        return f"it is {_kind(fields)}, expected a mapping of fields with `{entry.fields()[0].field}`"
    for field in entry.fields():
        try:
            _argument(field, fields, _term)
        except _Absent:
            continue
        except _UNUSABLE as wrong:
            if field.field.partition(".")[0] not in fields:
                there = shortened(", ".join(map(str, fields)), 200)
                return f"no field `{field.field}`, only {there or 'an empty payload'}"
            return f"`{field.field}`: {f'no {wrong}' if isinstance(wrong, LookupError) else wrong}"
    return str(error)


def _kind(value: object) -> str:
    """Return what a value is, for people."""
    match value:
        case None:
            return "null"
        case Mapping():
            return "an object"
        case list() | tuple():
            return "a list"
    return f"of the type {type(value).__name__}"


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"{value} is not a finite number")
    return value


def _converted(value: float, scale: float, offset: float) -> float:
    return _finite(float(f"{value * scale + offset:.{DIGITS}g}"))


def _argument(field: Field, message: object, term: ToTerm) -> Term:
    value = message
    for step in field.field.split("."):
        if isinstance(value, _LISTS):
            value = value[int(step)]
        elif isinstance(value, Mapping):
            value = value[step]
        else:
            raise TypeError(f"no {step} in {_kind(value)}")
    if field.each:
        return _elements(field, value, term)
    if isinstance(value, _LISTS):
        return [_value(field, item, term) for item in value if not _unknown(field, item)]
    if _unknown(field, value):
        raise _Absent
    return _value(field, value, term)


def _unknown(field: Field, value: object) -> bool:
    """Whether a value means that the robot does not know it: the one that the manifest names, and NaN."""
    return value != value or (field.absent is not None and value == field.absent)


def _elements(field: Field, value: object, term: ToTerm) -> list[Term]:
    """Return the picked values of each structure in a list, without those that lack a value which may be absent."""
    if not isinstance(value, _LISTS):
        raise TypeError(f"expected a list, got {_kind(value)}")
    parts = field.parts()
    found: list[Term] = []
    for element in value:
        try:
            taken = [_argument(part, element, term) for part in parts]
        except _Absent:
            continue
        alone = len(parts) == 1 and (bool(parts[0].each) or term is not percept_value)  # the paper wrapped `[](name)`
        found.append(taken[0] if alone else taken)
    return found


def _value(field: Field, value: object, term: ToTerm) -> Term:
    """Convert a value, or every number in a list of lists."""
    if isinstance(value, _LISTS):
        return [_value(field, item, term) for item in value]
    if isinstance(value, _NUMBERS) and not isinstance(value, bool) and (field.scale, field.offset) != (1.0, 0.0):
        value = _converted(value, field.scale, field.offset)
    return term(value)


def _term(value: object) -> Term:
    match value:
        case float():
            return _finite(value)
        case bool() | int() | str() | Atom():
            return value
        case bytes() | bytearray():
            return list(value)
    raise TypeError(f"expected a number, text, truth value or list, got {_kind(value)}")
