"""When mission second 0 was and how fast mission time goes, as `argosy run` tells it, or else the minds."""

from __future__ import annotations

import math
from collections import deque

from schemas.mission.model import Mission

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
DRIFT = 1.0
"""Wall seconds by which second 0 may come to lie later before it is corrected: a fleet may be slower than its speed."""
BACK = 0.5
"""Mission seconds by which a clock must have gone back to be that of a new life."""
RUN = "/run"
"""Stands for `argosy run` among the agents; no agent can be called so."""


class MissionClock:
    """The clock of one run of a fleet. Its agents begin at about the same time, and answers come late, never early.

    The clock of `argosy run`, which its screen and its report have too, counts before those of minds. An agent that was
    restarted counts from its restart: it is not asked any more, so that the fleet's clock goes on.
    """

    def __init__(self, mission: Mission | None) -> None:
        self.speed = 1.0
        """Mission seconds in a wall second."""
        self.zero: float | None = None
        """Unix seconds of mission second 0; None = nobody has told yet, or another run has begun."""
        self._told: dict[str, deque[tuple[float, float]]] = {}
        """What each agent has told lately: when it was heard, and its mission time."""
        self._restarted: set[str] = set()
        self.expect(mission)

    def expect(self, mission: Mission | None) -> None:
        """Take the speed that a mission declares, until one is measured."""
        self._likely = 1.0 if mission is None else mission.speed
        if self.zero is None:
            self.speed = self._likely

    def look(self, agent: str, time: float, heard: float) -> None:
        """An agent that was heard now has told its mission time."""
        if not math.isfinite(time) or RUN in self._told or (agent in self._restarted and self.zero is not None):
            return
        told = self._told.get(agent)
        if told and time < told[-1][1] - BACK:
            self.restarted(agent)
            return
        self._take(agent, time, heard)

    def look_at_run(self, time: float, speed: float, heard: float) -> None:
        """`argosy run` has told its mission time, and how fast that goes."""
        told = self._told.get(RUN)
        if told is None or time < told[-1][1] - BACK:
            self.begin()
        self.speed = speed
        self._take(RUN, time, heard)

    def restarted(self, agent: str) -> None:
        """An agent has begun a new life, whose clock begins with it."""
        self._told.pop(agent, None)
        self._restarted.add(agent)

    def begin(self) -> None:
        """Another run begins: what was told is of other clocks. The speed stays until it is measured."""
        self._told.clear()
        self._restarted.clear()
        self.zero = None

    def seconds(self, at: float) -> float | None:
        """Return the mission seconds at a time in Unix seconds; None = not known."""
        return None if self.zero is None else max(0.0, (at - self.zero) * self.speed)

    def _take(self, teller: str, time: float, heard: float) -> None:
        told = self._told.setdefault(teller, deque(maxlen=KEPT))
        told.append((heard, time))
        self._forget(heard)
        if teller != RUN:
            self._measure(told)
        zero = min(at - mission / self.speed for one in self._told.values() for at, mission in one)
        if self.zero is None or zero < self.zero - 0.005 or zero > self.zero + DRIFT:
            self.zero = round(zero, 2)

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
