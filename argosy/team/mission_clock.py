"""When mission second 0 was and how fast mission time goes, as the minds of a fleet tell whenever they are heard."""

from __future__ import annotations

import math
from collections import deque

from schemas.mission import Mission

WINDOW = 10.0
"""Wall seconds over which the speed is measured and second 0 is looked for: a run may have another than its file."""
BASE = 3.0
"""Wall seconds that must lie between two answers to measure a speed by them."""
KEPT = 64
"""Answers of one agent that are kept; of one that is looked at closely there are two a second."""
MOST = 16
"""Agents by which the time is taken."""
ALIKE = 0.1
"""Share by which a measured speed may differ from what is likely and count as that."""
ANEW = 1.0
"""Wall seconds by which second 0 must have moved forward to be another one."""
BACK = 0.5
"""Mission seconds by which a clock must have gone back to be that of a new life."""


class MissionClock:
    """The clock of a fleet. Its agents begin at about the same time, and answers come late, never early."""

    def __init__(self, mission: Mission | None) -> None:
        self.speed = self._likely = 1.0 if mission is None else mission.speed
        """Mission seconds in a wall second."""
        self.zero: float | None = None
        """Unix seconds of mission second 0; None = no mind has told yet, or all have begun anew."""
        self._told: dict[str, deque[tuple[float, float]]] = {}
        """What each agent has told lately: when it was heard, and its mission time."""

    def look(self, agent: str, time: float, heard: float) -> None:
        """An agent that was heard now has told its mission time."""
        if not math.isfinite(time):
            return
        told = self._told.setdefault(agent, deque(maxlen=KEPT))
        if told and time < told[-1][1] - BACK:  # a new life: what the one before told is of another clock
            told.clear()
            if all(name == agent or heard - one[-1][0] > WINDOW for name, one in self._told.items()):
                self.zero = None
        told.append((heard, time))
        self._forget(heard)
        self._measure(told)
        zero = min(at - mission / self.speed for one in self._told.values() for at, mission in one)
        if self.zero is None or zero < self.zero - 0.005 or zero > self.zero + ANEW:
            self.zero = round(zero, 2)

    def begin(self) -> None:
        """All begin anew: what was told is of other clocks. The speed stays until it is measured."""
        self._told.clear()
        self.zero = None

    def _forget(self, now: float) -> None:
        """Forget what is too old to measure by, so that no pause, lost router or agent that has gone counts."""
        for name in list(self._told):
            told = self._told[name]
            while told and now - told[0][0] > WINDOW:
                told.popleft()
            if not told:
                del self._told[name]
        while len(self._told) > MOST:
            del self._told[next(reversed(self._told))]

    def _measure(self, told: deque[tuple[float, float]]) -> None:
        (since, then), (heard, time) = told[0], told[-1]
        if heard - since < BASE or told is not next(iter(self._told.values())):
            return
        speed = max(0.01, (time - then) / (heard - since))
        likely = [one for one in (self.speed, self._likely, float(round(speed))) if abs(one - speed) < ALIKE * speed]
        measured = likely[0] if likely else float(f"{speed:.2g}")
        if measured != self.speed:
            self.speed, self.zero = measured, None
