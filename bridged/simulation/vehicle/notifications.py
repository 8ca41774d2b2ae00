"""Notifications of a simulated copter, and results of its commands."""

from dataclasses import dataclass
from enum import IntEnum


class Result(IntEnum):
    """result of COMMAND_ACK (MAV_RESULT)."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


class Severity(IntEnum):
    """severity of STATUSTEXT (MAV_SEVERITY)."""

    CRITICAL = 2
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


@dataclass(frozen=True, slots=True)
class Text:
    """STATUSTEXT."""

    severity: Severity
    text: str


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """Another flight mode: a HEARTBEAT is sent immediately."""


@dataclass(frozen=True, slots=True)
class HomeChanged:
    """Home was set: GPS_GLOBAL_ORIGIN and HOME_POSITION."""


@dataclass(frozen=True, slots=True)
class ParameterChanged:
    """The vehicle itself changed a parameter: PARAM_VALUE."""

    name: str


@dataclass(frozen=True, slots=True)
class ItemReached:
    """A mission item is done: MISSION_ITEM_REACHED."""

    seq: int


@dataclass(frozen=True, slots=True)
class MissionChanged:
    """Another item is the current one, or the state of the mission has changed: PX4 sends MISSION_CURRENT."""


@dataclass(frozen=True, slots=True)
class Number:
    """News by a number (EVENT of PX4)."""

    number: int
    levels: int
    """log_levels: the severity for others in its low four bits, for logs in the high ones."""
    arguments: bytes = b""


@dataclass(frozen=True, slots=True)
class Done:
    """A command that took its time is done: the acknowledgement with its result."""

    command: int
    result: Result
    peer: tuple[int, int]


Event = Text | ModeChanged | HomeChanged | ParameterChanged | ItemReached | MissionChanged | Number | Done
