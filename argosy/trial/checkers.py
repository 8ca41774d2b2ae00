"""What must hold in every run, judged from outside: by the records on the bus and the true state of the vehicles."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec

from argosy.trial.network import Sample, Session
from argosy.trial.world import World
from schemas.mission.model import Mission
from schemas.wire import keys
from schemas.wire.records import ActionStatus

SLACK: Final = 2.0
"""Metres by which a limit may be passed before it counts: vehicles overshoot, and do not measure the truth."""
HOME: Final = frozenset(("RTL", "LAND", "SMART_RTL"))
"""Modes in which a vehicle comes down by itself."""
UNATTENDED: Final = 30.0
"""Virtual seconds beside what the mission declares for which a vehicle may be in the air with nobody in charge."""


class Violation(msgspec.Struct, frozen=True):
    """What must not be."""

    rule: str
    """Short name of the checker."""
    at: float
    """Virtual seconds after the start."""
    text: str


class Checkers:
    """All checkers of a run; each rule is reported once for each subject."""

    def __init__(self, mission: Mission, world: World, served: Callable[[str], bool]) -> None:
        """`served(robot)`: whether an agent of the robot is running."""
        self._mission, self._world, self._served = mission, world, served
        self.found: list[Violation] = []
        self._told: set[tuple[str, str]] = set()
        self._ends: dict[str, tuple[str, str]] = {}
        self._alone: dict[str, float] = {}
        """Since when each vehicle is in the air with nobody in charge."""
        world.network.on_put.append(self._put)
        world.looks.append(self._look)

    def _tell(self, rule: str, subject: str, text: str) -> None:
        if (rule, subject) not in self._told:
            self._told.add((rule, subject))
            self.found.append(Violation(rule, round(self._world.network.loop.time(), 2), text))

    def _put(self, session: Session, sample: Sample) -> None:
        parsed = keys.parse(sample.key_expr)
        if parsed is None or parsed[2][0] != "status":
            return
        status = msgspec.json.decode(sample.payload.to_bytes(), type=ActionStatus)
        if not status.final:
            return
        end = status.state, status.reason
        before = self._ends.setdefault(status.id, end)
        if before != end:
            text = f"{status.name} {status.id} ended as {before[0]} ({before[1]}) and as {end[0]} ({end[1]})"
            self._tell("one final status", status.id, text)

    def _look(self) -> None:
        now = self._world.network.loop.time()
        for name, seen in self._world.vehicles.items():
            robot = self._mission.robots[name]
            limits = robot.limits
            if limits.altitude is not None and seen.height > limits.altitude + SLACK:
                self._tell("limits", f"{name} altitude", f"{name} is at {seen.height:.1f} m of {limits.altitude:g} m")
            if limits.radius is not None and seen.farthest > limits.radius + SLACK:
                self._tell("limits", f"{name} radius", f"{name} was {seen.farthest:.0f} m from home")
            unattended = seen.armed and seen.height > 1 and seen.mode not in HOME and not self._served(name)
            if not unattended:
                self._alone.pop(name, None)
                continue
            since = self._alone.setdefault(name, now)
            if now - since > float(robot.agent_silence) + UNATTENDED:
                self._tell(
                    "nobody alone", name, f"{name} is in the air in {seen.mode}, without an agent since {since:.0f} s"
                )

    def finish(self) -> list[Violation]:
        """Judge the end of the run; return everything that was found."""
        for name, seen in self._world.vehicles.items():
            if seen.armed:
                self._tell("on the ground", name, f"the run is over and {name} is armed, {seen.height:.1f} m high")
        return self.found
