"""STATUSTEXTs of a vehicle, kept for a while: they come before or after the acknowledgement that they explain."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.vehicle.px4_events import Event

MAX_TEXTS = 50
MAX_CHUNKS = 16
"""Chunks of one long text (MAVLink 2: 50 characters each)."""
CHUNK = 50
"""Characters of a chunk that another one follows."""
MAX_INFORMATION = 3
"""Texts of no weight that a reason shows when there was no warning; the last ones."""
NOTABLE = dialect.MAV_SEVERITY_WARNING
"""Refusals come as warnings and worse; information is left out of reasons when there is something worse."""
SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
"""MAV_SEVERITY by its number."""
REPEATS_WITHIN = (60.0, 60.0)
"""Mission and wall seconds within which a text is a repetition: ArduPilot reports obstacles to arming every 30 s."""
MAX_DISTINCT = 20
"""Different warnings in that time that are passed on; a vehicle that floods its link has the others counted."""


class StatusText(NamedTuple):
    """One whole text of the vehicle."""

    at: float
    """Mission seconds."""
    severity: int
    """MAV_SEVERITY: 0 is the worst."""
    text: str


@dataclass
class _Long:
    """A text that comes in chunks."""

    number: int
    severity: int
    chunks: dict[int, str] = field(default_factory=dict)

    @property
    def whole(self) -> bool:
        last = max(self.chunks)
        ended = len(self.chunks[last]) < CHUNK or last >= MAX_CHUNKS - 1
        return ended and len(self.chunks) == last + 1

    def text(self) -> str:
        """Return the received chunks, with ... for lost ones."""
        return "".join(self.chunks.get(seq, "...") for seq in range(max(self.chunks) + 1))


class Texts:
    """The last texts with the time at which they came; times are mission seconds."""

    def __init__(self) -> None:
        self._texts: deque[StatusText] = deque(maxlen=MAX_TEXTS)
        self._long: _Long | None = None
        self._spoken = False
        """Whether the vehicle sends texts at all."""

    def receive(self, message: dialect.MAVLink_message, now: float) -> list[StatusText]:
        """Take in a STATUSTEXT, or one chunk of a long one. Returns the texts that are whole by it.

        A long text of which a chunk was lost is given up when the next text begins. The first long text of a PX4 has
        the number of short ones (0): its first chunk counts as whole until the next one arrives.
        """
        self._spoken = True
        before = self._texts[-1] if self._texts else None
        if not message.id and message.chunk_seq and before is not None and len(before.text) == CHUNK:
            self._texts.pop()
            return self._keep(message.severity, before.text + message.text, now)
        whole: list[StatusText] = []
        if self._long is not None and message.id != self._long.number:
            whole += self._keep(self._long.severity, self._long.text(), now)
            self._long = None
        if not message.id:
            return whole + self._keep(message.severity, message.text, now)
        if self._long is None:
            self._long = _Long(message.id, message.severity)
        self._long.chunks[min(message.chunk_seq, MAX_CHUNKS - 1)] = message.text
        if self._long.whole:
            whole += self._keep(self._long.severity, self._long.text(), now)
            self._long = None
        return whole

    def receive_event(self, event: Event, now: float) -> list[StatusText]:
        """Take in an event as text, unless the vehicle sends texts and so will report the same."""
        return [] if self._spoken and not event.alone else self._keep(event.severity, event.text, now)

    def since(self, when: float) -> str:
        """Return the warnings since `when` (mission seconds), without repetitions; if there is none, the last texts."""
        texts = [one.text for one in self._texts if one.at >= when]
        return self.warnings(when) or "; ".join(dict.fromkeys(texts[-MAX_INFORMATION:]))

    def warnings(self, when: float) -> str:
        """Return the warnings and worse since a time in mission seconds, without repetitions."""
        return "; ".join(dict.fromkeys(one.text for one in self._texts if one.at >= when and one.severity <= NOTABLE))

    def beginning(self, prefix: str, when: float) -> list[str]:
        """Return the rest of each text since `when` (mission seconds) that begins with `prefix`, each once."""
        texts = (one.text.removeprefix(prefix) for one in self._texts if one.at >= when and one.text.startswith(prefix))
        return list(dict.fromkeys(texts))

    def _keep(self, severity: int, text: str, now: float) -> list[StatusText]:
        if not (text := text.strip()):
            return []
        self._texts.append(StatusText(now, severity, text))
        return [self._texts[-1]]


class Warnings:
    """Which of the vehicle's warnings are new: each once while it is repeated, `MAX_DISTINCT` at most."""

    def __init__(self) -> None:
        self.dropped = 0
        """Warnings so far that were not passed on, as there were too many."""
        self._heard: dict[tuple[int, str], float] = {}

    def take(self, text: StatusText, within: float) -> bool | None:
        """Take in a text. Returns whether it is news, None if it is not passed on; `within`: mission seconds."""
        if text.severity > NOTABLE:
            return None
        self._heard = {known: at for known, at in self._heard.items() if text.at - at <= within}
        known = (text.severity, text.text)
        new = known not in self._heard
        if new and len(self._heard) >= MAX_DISTINCT:
            self.dropped += 1
            return None
        self._heard[known] = text.at
        return new
