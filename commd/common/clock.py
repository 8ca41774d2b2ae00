"""The clock of a process: mission time, which runs `speed` times as fast as wall time."""

from __future__ import annotations

import asyncio
import time
from datetime import timedelta, timezone, tzinfo


class Clock:
    """Mission time in seconds since the clock was made; `speed`: mission seconds per wall second, above 0."""

    def __init__(self, speed: float = 1.0) -> None:
        self.speed = speed
        self._start = time.monotonic()
        self.epoch = time.time()
        """Unix time in seconds at which mission time was 0."""
        self.zone: tzinfo = timezone(timedelta(seconds=time.localtime().tm_gmtoff))
        """The time zone of `.time` and `.date`."""

    def now(self) -> float:
        """Return mission seconds since the start; never goes back."""
        return (time.monotonic() - self._start) * self.speed

    def wall(self) -> float:
        """Return wall seconds since the start; for acknowledgements, liveliness, retries and link loss."""
        return time.monotonic() - self._start

    def to_wall(self, mission_seconds: float) -> float:
        """Return the wall seconds of a span of mission seconds."""
        return mission_seconds / self.speed

    async def sleep(self, mission_seconds: float) -> None:
        """Sleep for a span of mission seconds."""
        await asyncio.sleep(max(0.0, self.to_wall(mission_seconds)))
