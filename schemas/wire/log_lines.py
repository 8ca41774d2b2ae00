"""Log lines of a daemon for its supervisor: JSON objects, with records of the events that it acts on.

With `ARGOSY_LOG=json` in its environment a daemon writes these; otherwise it writes the same texts for people.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Literal

import msgspec

from schemas.wire.records import Order, Record

AS_JSON: Mapping[str, str] = {"ARGOSY_LOG": "json"}
"""Environment variable by which a supervisor requests `LogLine`s from a process."""
LONGEST = 4_000
"""Characters of a text; the rest is counted."""

Level = Literal["error", "warning", "notice", "info"]
"""`notice`: requested output; `info`: for log files."""


LeftAs = Literal["disarmed", "ordered", "piloted", "unconfirmed"]
"""The state in which a bridge has left a robot.

`disarmed`: connected and disarmed. `ordered`: the vehicle has confirmed an order, or carries it out already. `piloted`:
others fly it, and nothing was ordered. `unconfirmed`: it may be armed, and no order was confirmed.
"""


class Event(Record, frozen=True, kw_only=True, tag_field="event"):
    """An event that the supervisor of a daemon acts on."""


class RobotLeft(Event, frozen=True, kw_only=True, tag="robot_left"):
    """A bridge has ended its service for a robot."""

    robot: str
    state: LeftAs
    order: Order | None = None
    """The order that the vehicle has confirmed (`ordered`)."""
    text: str = ""
    """For people."""


class OrderEnded(Event, frozen=True, kw_only=True, tag="order_ended"):
    """The end of an operator's order to a robot, confirmed or not."""

    robot: str
    order: Order
    confirmed: bool
    reason: str = ""
    """For people."""


class RobotReleased(Event, frozen=True, kw_only=True, tag="robot_released"):
    """The operator has released a robot to its agents."""

    robot: str


class RecordingStarted(Event, frozen=True, kw_only=True, tag="recording_started"):
    """The recording has started."""


class RecordingEnded(Event, frozen=True, kw_only=True, tag="recording_ended"):
    """The file of a recording is complete."""

    text: str
    """Summary of its contents, for people."""


AnyEvent = RobotLeft | OrderEnded | RobotReleased | RecordingStarted | RecordingEnded


class LogLine(Record, frozen=True, kw_only=True):
    """One line of a process."""

    text: str
    level: Level = "notice"
    agent: str = ""
    """The agent that printed it; empty = the process itself."""
    event: AnyEvent | None = None


_ENCODER = msgspec.json.Encoder()
_DECODER = msgspec.json.Decoder(LogLine)


def wanted() -> bool:
    """Whether this process must write its lines as JSON."""
    return all(os.environ.get(name) == value for name, value in AS_JSON.items())


def encode(line: LogLine) -> bytes:
    """Return a line as JSON, without a line break."""
    return _ENCODER.encode(line)


def decode(data: bytes) -> LogLine | None:
    """Return an encoded line; None for any other text."""
    try:
        return _DECODER.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return None


def cut(text: str) -> str:
    """Return the first `LONGEST` characters of a text, and how many more there were."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}… ({len(text) - LONGEST} characters more)"
