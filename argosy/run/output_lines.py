"""What the lines mean that daemons write: their level, their text, and what a bridge says of its vehicle."""

from __future__ import annotations

import re
from dataclasses import dataclass

from argosy.cli.journal import Level

_LOGGED = re.compile(r"(DEBUG|INFO|WARNING|ERROR|CRITICAL) \S+ \S+ (.*)")
"""The format of `commd.process.process`: level, daemon, logger, message."""
_LEVELS: dict[str, Level] = {"WARNING": "warning", "ERROR": "error", "CRITICAL": "error"}
_LEFT = re.compile(r"leaving (\S+): (.*)")
_ORDERED = re.compile(r"robot=(\S+) (hold|land|rtl) \(operator: \2\): (\w+) ?(.*)")
_RELEASED = re.compile(r"robot=(\S+) released: actions are taken again")


@dataclass(frozen=True)
class Line:
    """A line without what the journal shows in other ways: who wrote it, and how grave it is."""

    text: str
    level: Level = "output"
    """`detail` for what a daemon only informs about."""


@dataclass(frozen=True)
class Left:
    """A bridge left a vehicle; `how` is `not armed`, `rtl: ...` when confirmed, or why no order was."""

    robot: str
    how: str

    @property
    def confirmed(self) -> str:
        """The order that the vehicle confirmed; nothing if it confirmed none."""
        order = self.how.partition(":")[0]
        return order if order in ("hold", "land", "rtl") else ""

    @property
    def to_pilot(self) -> bool:
        """Whether a pilot has the vehicle, so that the bridge ordered nothing."""
        return self.how.startswith("left to the pilot")


@dataclass(frozen=True)
class Ordered:
    """An operator's order has an outcome."""

    robot: str
    order: str
    confirmed: bool
    reason: str


@dataclass(frozen=True)
class Released:
    """The operator lets the agents of a robot act again."""

    robot: str


def read_line(text: str) -> Line:
    """Return what a line says and how grave it is."""
    if logged := _LOGGED.fullmatch(text):
        return Line(logged[2], _LEVELS.get(logged[1], "detail"))
    return Line(text, "error" if text.startswith("error:") else "output")


def of_a_bridge(line: Line) -> Left | Ordered | Released | None:
    """Return what a bridge's line says of one of its vehicles, if it does."""
    if left := _LEFT.fullmatch(line.text):
        return Left(left[1], left[2])
    if ordered := _ORDERED.fullmatch(line.text):
        return Ordered(ordered[1], ordered[2], ordered[3] == "succeeded", ordered[4])
    if released := _RELEASED.fullmatch(line.text):
        return Released(released[1])
    return None
