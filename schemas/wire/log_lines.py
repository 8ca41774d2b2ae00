"""Lines that a daemon writes for the program that started it: one JSON object each, with records for what it acts on.

With `ARGOSY_LOG=json` in its environment a daemon writes these lines; else it writes the same texts, for people.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Literal

import msgspec

from schemas.wire.records import Order, Record

AS_JSON: Mapping[str, str] = {"ARGOSY_LOG": "json"}
"""What a supervisor adds to the environment of a process to get `LogLine`s from it."""
LONGEST = 4_000
"""Characters of a text; the rest is counted."""

Level = Literal["error", "warning", "notice", "info"]
"""`notice`: output that was asked for; `info`: what only a log file needs."""


LeftAs = Literal["disarmed", "ordered", "piloted", "unconfirmed"]
"""How a bridge has left a robot.

`disarmed`: it is heard, and not in use. `ordered`: the vehicle has confirmed an order, or does it already. `piloted`:
others fly it, and nothing was ordered. `unconfirmed`: it may be in use, and no order was confirmed.
"""


class Event(Record, frozen=True, kw_only=True, tag_field="event"):
    """Something that the supervisor of a daemon acts on."""


class RobotLeft(Event, frozen=True, kw_only=True, tag="robot_left"):
    """A bridge has ended its service for a robot."""

    robot: str
    state: LeftAs
    order: Order | None = None
    """What the vehicle has confirmed (`ordered`)."""
    text: str = ""
    """For people."""


class OrderEnded(Event, frozen=True, kw_only=True, tag="order_ended"):
    """A robot has carried out an operator's order, or has not."""

    robot: str
    order: Order
    confirmed: bool
    reason: str = ""
    """For people."""


class RobotReleased(Event, frozen=True, kw_only=True, tag="robot_released"):
    """The operator lets the agents of a robot act again."""

    robot: str


class RecordingStarted(Event, frozen=True, kw_only=True, tag="recording_started"):
    """From now on everything is recorded."""


class RecordingEnded(Event, frozen=True, kw_only=True, tag="recording_ended"):
    """The file of a recording is complete."""

    text: str
    """What it holds, for people."""


AnyEvent = RobotLeft | OrderEnded | RobotReleased | RecordingStarted | RecordingEnded


class LogLine(Record, frozen=True, kw_only=True):
    """One line of a process."""

    text: str
    level: Level = "notice"
    agent: str = ""
    """Whose program has printed it; empty = the process itself says it."""
    event: AnyEvent | None = None


_ENCODER = msgspec.json.Encoder()
_DECODER = msgspec.json.Decoder(LogLine)


def wanted() -> bool:
    """Whether this process is to write its lines as JSON."""
    return all(os.environ.get(name) == value for name, value in AS_JSON.items())


def encode(line: LogLine) -> bytes:
    """Return a line as JSON, without a line break."""
    return _ENCODER.encode(line)


def decode(data: bytes) -> LogLine | None:
    """Return a line that was encoded; None for any other text."""
    try:
        return _DECODER.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None


def cut(text: str) -> str:
    """Return the first `LONGEST` characters of a text, and how many more there were."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}… ({len(text) - LONGEST} characters more)"
