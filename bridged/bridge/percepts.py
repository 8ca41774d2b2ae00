"""What the agents of a robot perceive now: told when it changes, at most so often, and gone when its source is silent.

Pure: beliefs and the time (mission seconds) go in, perceptions come out (design section 4).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

import msgspec

from bridged.bridge.translation import Belief, Translator
from bridged.drivers.api import Reading
from schemas.manifest.loader import Manifest, PerceptEntry
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import Header, Perception
from schemas.wire.terms import Term, to_float

MAX_BELIEFS = 1000
"""Beliefs that a robot may give at once; the oldest goes first, and is counted."""
MAX_SOURCES = 256
"""Sources whose last reading is kept."""
JITTER = 0.25
"""Part of the period by which a change may come too soon or too late and count as on time: a 10 Hz source must not be
halved by its jitter. On average no more than the rate is told."""

_ENCODE = msgspec.msgpack.Encoder().encode

Parameters = tuple[Term, ...]
Update = Literal["replace", "add", "remove"]
Publish = Callable[[str, Perception], None]
"""Called with the agent and what it is to perceive."""


@dataclass(slots=True)
class _Slot:
    name: str
    entry: PerceptEntry
    told: Parameters
    due: float
    """When the next change may be told, in mission seconds."""
    heard_at: float
    waiting: Parameters | None = None
    """The newest value, held back by the rate."""


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
        stamp: Callable[[], int],
        speed: float = 1.0,
    ) -> None:
        self.translator = Translator(manifest)
        self._percepts = manifest.percepts
        self.expired = 0
        """Beliefs removed so far because their source fell silent."""
        self.dropped = 0
        """Beliefs removed so far because there were too many."""
        self.sets = {agent: PerceptSet() for agent in agents}
        self._publish = publish
        self._robot, self._boot, self._stamp = robot, boot, stamp
        self._patience = max(1.0, speed)
        self._slots: dict[tuple[object, ...], _Slot] = {}
        self._last: dict[tuple[str, str], tuple[Reading, float]] = {}
        """The last reading of each source and when it came: some sources say a thing once."""

    def adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest: what it declares as before is untouched, what it does not declare is withdrawn.

        A percept that is declared otherwise keeps its belief until the next reading, unless that would be another
        belief: of another source, number of arguments or identity. That one, and what is new, is made of what the
        source said last.
        """
        old, new = self._percepts, manifest.percepts
        made = {
            name for name in new if name not in old or _identity(new[name], manifest) != _identity(old[name], manifest)
        }
        for key, slot in list(self._slots.items()):
            if slot.name not in old:
                continue
            entry = new.get(slot.name)
            if entry is None or _identity(entry, manifest) != _identity(slot.entry, manifest):
                self._remove(key)
            else:
                slot.due += _period(entry) - _period(slot.entry)
                slot.entry = entry
        self.translator = Translator(manifest, self.translator.unreadable)
        self._percepts = new
        for reading, at in list(self._last.values()):
            for belief in self.translator.beliefs(reading):
                events = (belief.entry.buf, old.get(belief.name, belief.entry).buf)  # what happened is over
                if belief.name in made and "add" not in events and belief.parameters is not None:
                    self._hear(belief, belief.parameters, at)

    def take(self, reading: Reading, now: float) -> None:
        """Take in what the robot said."""
        source = (reading.driver, reading.source)
        if reading.fields is None:
            self._last.pop(source, None)
        elif source in self._last or len(self._last) < MAX_SOURCES:
            self._last[source] = (reading, now)
        for belief in self.translator.beliefs(reading):
            if belief.parameters is None:
                self._withdraw(belief.name)
            else:
                self._hear(belief, belief.parameters, now)

    def tick(self, now: float) -> None:
        """Tell what the rate held back, and remove what has aged."""
        for key, slot in list(self._slots.items()):
            if slot.waiting is not None and now >= slot.due:
                self._tell(slot, slot.waiting, now)
            ttl = slot.entry.ttl
            if ttl is not None and now - slot.heard_at > ttl * self._patience:
                self.expired += 1
                self._remove(key)

    def flush(self, now: float) -> None:
        """Tell everything that is held back: the truth must be there before the status that refers to it."""
        for slot in self._slots.values():
            if slot.waiting is not None:
                self._tell(slot, slot.waiting, now)

    def show(self, agent: str, name: str, parameters: Parameters, key: tuple[int, ...] = ()) -> None:
        """Tell one agent what only it perceives, if it has changed: about its action, or about it."""
        if not any(one.name == name and one.parameters == parameters for one in self.sets[agent].present()):
            self._send_to(agent, name, parameters, "replace", key)

    def withdraw(self, agent: str, name: str, first: Parameters = ()) -> None:
        """Remove what was shown to one agent under a name, if its first arguments are these."""
        for one in self.sets[agent].present():
            if one.name == name and one.parameters[: len(first)] == first:
                self._send_to(agent, name, one.parameters, "remove", tuple(range(len(one.parameters))))

    def last_seq(self, agent: str) -> int:
        """Seq of the last perception that was published to an agent."""
        return self.sets[agent].seq

    def _hear(self, belief: Belief, parameters: Parameters, now: float) -> None:
        entry = belief.entry
        identity = parameters if entry.buf == "add" else tuple(parameters[position] for position in entry.key)
        key = (belief.name, _ENCODE(identity))
        slot = self._slots.get(key)
        if slot is None:
            while len(self._slots) >= MAX_BELIEFS:
                self.dropped += 1
                self._remove(next(iter(self._slots)))
            slot = self._slots[key] = _Slot(belief.name, entry, parameters, -math.inf, now)
            self._tell(slot, parameters, now)
            return
        slot.heard_at = now
        if entry.buf == "update" and not _changed(slot.told, parameters, entry.deadband):
            slot.waiting = None
        elif entry.buf == "add" or now >= slot.due - JITTER * _period(entry):
            self._tell(slot, parameters, now)
        else:
            slot.waiting = parameters

    def _tell(self, slot: _Slot, parameters: Parameters, now: float) -> None:
        period = _period(slot.entry)
        slot.told, slot.waiting = parameters, None
        on_time = abs(now - slot.due) <= JITTER * period
        slot.due = (slot.due if on_time else now) + period  # one that came a little late does not hold up the next
        self._send(slot.name, parameters, "add" if slot.entry.buf == "add" else "replace", slot.entry.key)

    def _withdraw(self, name: str) -> None:
        for key in [key for key, slot in self._slots.items() if slot.name == name]:
            self._remove(key)

    def _remove(self, key: tuple[object, ...]) -> None:
        slot = self._slots.pop(key)
        self._send(slot.name, slot.told, "remove", tuple(range(len(slot.told))))

    def _send(self, name: str, parameters: Parameters, update: Update, key: tuple[int, ...]) -> None:
        for agent in self.sets:
            self._send_to(agent, name, parameters, update, key)

    def _send_to(self, agent: str, name: str, parameters: Parameters, update: Update, key: tuple[int, ...]) -> None:
        present = self.sets[agent]
        header = Header(seq=present.seq + 1, stamp=self._stamp(), source=self._robot, boot=self._boot)
        perception = Perception(header=header, name=name, parameters=parameters, update=update, key=key)
        present.apply(perception)
        self._publish(agent, perception)


def _identity(entry: PerceptEntry, manifest: Manifest) -> tuple[object, ...]:
    """What makes a percept the same one although its entry has changed."""
    return (
        manifest.driver_of(entry),
        entry.source,
        entry.arity,
        entry.key,
        entry.buf,
        *(entry.fields()[position].field for position in entry.key),
    )


def _period(entry: PerceptEntry) -> float:
    return 0.0 if entry.rate is None else 1.0 / entry.rate


def _changed(told: Parameters, now: Parameters, deadband: float) -> bool:
    """Whether a belief has become another one; numbers within the deadband of what was told have not."""
    return any(_differs(old, new, deadband) for old, new in zip(told, now, strict=True))


def _differs(old: Term, new: Term, deadband: float) -> bool:
    if type(old) is type(new) and old == new and not isinstance(old, list):
        return False
    if isinstance(old, list) and isinstance(new, list):
        return len(old) != len(new) or any(
            _differs(was, is_now, deadband) for was, is_now in zip(old, new, strict=True)
        )
    was, becomes = to_float(old), to_float(new)
    return was is None or becomes is None or not abs(becomes - was) <= deadband
