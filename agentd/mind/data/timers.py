"""Timers: what is to be done at a mission time."""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush


class Timer:
    """Something to do at a mission time."""

    __slots__ = ("action", "cancelled", "due", "number")

    def __init__(self, due: float, number: int, action: Callable[[], None]) -> None:
        self.due, self.number, self.action = due, number, action
        self.cancelled = False

    def __lt__(self, other: Timer) -> bool:
        return (self.due, self.number) < (other.due, other.number)


class Timers:
    """What is due when. Equal times keep the order in which they were set."""

    def __init__(self) -> None:
        self.heap: list[Timer] = []
        """The timers, the next one first; some may be cancelled."""
        self._count = 0
        self.looks = 0
        """How often the time has made a difference: for those who note what a mind is given (`agentd.trace`)."""

    def at(self, due: float, action: Callable[[], None]) -> Timer:
        self._count += 1
        self.looks += 1
        timer = Timer(due, self._count, action)
        heappush(self.heap, timer)
        return timer

    def next_due(self) -> float | None:
        """When the earliest timer is due; None without any."""
        while self.heap and self.heap[0].cancelled:
            heappop(self.heap)
        return self.heap[0].due if self.heap else None

    def run(self, now: float) -> None:
        """Do what is due."""
        while self.heap and (self.heap[0].cancelled or self.heap[0].due <= now):
            timer = heappop(self.heap)
            if not timer.cancelled:
                self.looks += 1
                timer.action()
