"""Estimate the mission time of a fleet and its speed, from `argosy run` or else from the minds."""

from __future__ import annotations

import math
import time
from collections import deque

from schemas.mission.model import Mission

WINDOW = 10.0
"""Wall seconds over which speed and second 0 are measured: a run may have another speed than its file."""
BASE = 3.0
"""Wall seconds between two answers that are needed to measure a speed."""
KEPT = 64
"""Answers of one agent that are kept; an agent that is looked at gives two a second."""
MOST = 16
"""Agents whose time is used."""
ALIKE = 0.1
"""Share by which a measured speed may differ from a likely one to count as that."""
DRIFT = 1.0
"""Wall seconds by which second 0 may move later before it is corrected: a fleet may be slower than its speed."""
BACK = 0.5
"""Mission seconds by which a clock must go back to be that of a new life."""
RUN = "/run"
"""Name of `argosy run` among the sources; no agent can have it."""


def steady_clock() -> float:
    """Return Unix seconds of a clock that never jumps, and that goes on while the machine sleeps."""
    return _EPOCH + time.clock_gettime(time.CLOCK_BOOTTIME)


_EPOCH = time.time() - time.clock_gettime(time.CLOCK_BOOTTIME)


class MissionClock:
    """The clock of one run of a fleet. Its agents begin at about the same time, and answers come late, never early.

    The clock of `argosy run`, which its screen and its report have too, counts before those of minds. An agent that was
    restarted counts from its restart: it is not asked any more, so that the fleet's clock goes on.
    """

    def __init__(self, mission: Mission | None) -> None:
        self.speed = 1.0
        """Mission seconds per wall second."""
        self.zero: float | None = None
        """Unix seconds of mission second 0; None = not known yet, or another run has begun."""
        self._samples: dict[str, deque[tuple[float, float]]] = {}
        """Samples of each agent: when it was heard, and its mission time."""
        self._restarted: set[str] = set()
        self.expect(mission)

    def expect(self, mission: Mission | None) -> None:
        """Use the speed that a mission declares until one is measured."""
        self._likely = 1.0 if mission is None else mission.speed
        if self.zero is None:
            self.speed = self._likely

    def look(self, agent: str, seconds: float, heard: float) -> None:
        """Take the mission time of an agent, in seconds, heard at `heard`."""
        if not math.isfinite(seconds) or RUN in self._samples or (agent in self._restarted and self.zero is not None):
            return
        samples = self._samples.get(agent)
        if samples and seconds < samples[-1][1] - BACK:
            self.restarted(agent)
            return
        self._take(agent, seconds, heard)

    def look_at_run(self, seconds: float, speed: float, heard: float) -> None:
        """Take the mission time of `argosy run` in `seconds`, heard at `heard`, and its speed."""
        samples = self._samples.get(RUN)
        if samples is None or seconds < samples[-1][1] - BACK:
            self.begin()
        self.speed = speed
        self._take(RUN, seconds, heard)

    def restarted(self, agent: str) -> None:
        """Ignore an agent from now on: its clock began again when it was restarted."""
        self._samples.pop(agent, None)
        self._restarted.add(agent)

    def begin(self) -> None:
        """Begin another run: forget the clocks of the one before. The speed stays until it is measured."""
        self._samples.clear()
        self._restarted.clear()
        self.zero = None

    def seconds(self, at: float) -> float | None:
        """Return the mission time in seconds at a Unix time in seconds; None = not known."""
        return None if self.zero is None else max(0.0, (at - self.zero) * self.speed)

    def _take(self, source: str, seconds: float, heard: float) -> None:
        samples = self._samples.setdefault(source, deque(maxlen=KEPT))
        samples.append((heard, seconds))
        self._forget(heard)
        if source != RUN:
            self._measure(samples)
        zero = min(at - mission / self.speed for one in self._samples.values() for at, mission in one)
        if self.zero is None or zero < self.zero - 0.005 or zero > self.zero + DRIFT:
            self.zero = round(zero, 2)

    def _forget(self, now: float) -> None:
        """Forget old samples, so that pauses, a lost router and agents that have left do not count."""
        for name in list(self._samples):
            samples = self._samples[name]
            while samples and now - samples[0][0] > WINDOW:
                samples.popleft()
            if not samples:
                del self._samples[name]
        while len(self._samples) > MOST:
            del self._samples[next(reversed(self._samples))]

    def _measure(self, samples: deque[tuple[float, float]]) -> None:
        (since, first), (heard, last) = samples[0], samples[-1]
        if heard - since < BASE or samples is not next(iter(self._samples.values())):
            return
        speed = max(0.01, (last - first) / (heard - since))
        likely = [one for one in (self.speed, self._likely, float(round(speed))) if abs(one - speed) < ALIKE * speed]
        measured = likely[0] if likely else float(f"{speed:.2g}")
        if measured != self.speed:
            self.speed, self.zero = measured, None
