"""When mission second 0 was and how fast mission time goes, as minds tell: a page lets its clock run on by itself."""

from __future__ import annotations

from argosy.team import TeamModel
from schemas.mission import Mission

BASE = 3.0
"""Wall seconds over which the speed is measured: a run may have another one than its mission file says."""
ALIKE = 0.1
"""Share by which a measured speed may differ from what is likely and count as that."""
ANEW = 3.0
"""Wall seconds by which second 0 must have moved to be another one: the agents were started again."""


class MissionTime:
    """The clock of a fleet. Its agents begin at about the same time; the first one's clock is the mission's."""

    def __init__(self, mission: Mission | None) -> None:
        self.speed = self._likely = 1.0 if mission is None else mission.speed
        self.zero: float | None = None
        """Unix seconds; None = no mind has told yet."""
        self._first: tuple[str, float, float] | None = None
        """The agent by which the speed is measured, when it was heard, and its time then."""

    def look(self, model: TeamModel) -> None:
        """Take what the minds have told."""
        told = [(one.mind.time, one.heard, name) for name, one in model.agents.items() if one.mind and one.heard]
        if not told:
            return
        self._measure({name: (heard, time) for time, heard, name in told})
        time, heard, _ = max(told)
        zero = heard - time / self.speed  # answers come late, never early: the earliest is the best
        if self.zero is None or zero < self.zero or zero > self.zero + ANEW:
            self.zero = round(zero, 2)

    def _measure(self, told: dict[str, tuple[float, float]]) -> None:
        name, since, then = self._first or ("", 0.0, 0.0)
        heard, time = told.get(name, (0.0, 0.0))
        if time < then or name not in told:
            name = next(iter(told))
            self._first = (name, *told[name])
        elif heard - since >= BASE:
            speed = max(0.01, (time - then) / (heard - since))
            likely = [
                one for one in (self.speed, self._likely, float(round(speed))) if abs(one - speed) < ALIKE * speed
            ]
            if not likely or likely[0] != self.speed:
                self.speed, self.zero = likely[0] if likely else float(f"{speed:.2g}"), None
