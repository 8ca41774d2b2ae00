"""When mission second 0 was and how fast mission time goes, as minds tell: a page lets its clock run on by itself."""

from __future__ import annotations

from argosy.team import TeamModel
from schemas.mission import Mission

JITTER = 0.5
"""Wall seconds by which a mind's answer may be late without its time being taken as another."""
BASE = 3.0
"""Wall seconds over which the speed is measured if no mission tells it."""


class MissionTime:
    """The clock of a fleet. Its agents begin at about the same time; the first one's clock is the mission's."""

    def __init__(self, mission: Mission | None) -> None:
        self._named = mission is not None
        self.speed = 1.0 if mission is None else mission.speed
        self.zero: float | None = None
        """Unix seconds; None = no mind has told yet."""
        self._first: tuple[str, float, float] | None = None
        """The agent by which the speed is measured, when it was heard, and its time then."""

    def look(self, model: TeamModel) -> None:
        """Take what the minds have told."""
        told = [(one.mind.time, one.heard, name) for name, one in model.agents.items() if one.mind and one.heard]
        if not told:
            return
        time, heard, name = max(told)
        if not self._named:
            self._measure(name, heard, time)
        zero = heard - time / self.speed
        if self.zero is None or abs(zero - self.zero) > JITTER:
            self.zero = round(zero, 2)

    def _measure(self, name: str, heard: float, time: float) -> None:
        if self._first is None or self._first[0] != name or time < self._first[2]:
            self._first = (name, heard, time)
        elif heard - self._first[1] >= BASE:
            speed = (time - self._first[2]) / (heard - self._first[1])
            self.speed = float(f"{max(speed, 0.01):.2g}")
            if abs(self.speed - round(self.speed)) < 0.1 * self.speed and self.speed > 0.9:
                self.speed = float(round(self.speed))
