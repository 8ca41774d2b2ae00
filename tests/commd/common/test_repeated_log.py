"""What goes on for long is said again at longer and longer intervals."""

from __future__ import annotations

import asyncio
import heapq
from collections.abc import Callable
from typing import Any, cast

import pytest

from commd.common import repeated_log
from commd.common.repeated_log import RepeatedLog


class Time:
    """An event loop's clock and calendar, moved by the test."""

    def __init__(self) -> None:
        self.at = 0.0
        self._calls: list[tuple[float, int, asyncio.TimerHandle]] = []

    def time(self) -> float:
        return self.at

    def call_at(self, when: float, call: Callable[..., None], *arguments: Any) -> asyncio.TimerHandle:
        handle = asyncio.TimerHandle(when, call, arguments, cast("asyncio.AbstractEventLoop", self))
        heapq.heappush(self._calls, (when, len(self._calls), handle))
        return handle

    def get_debug(self) -> bool:
        return False

    def _timer_handle_cancelled(self, handle: asyncio.TimerHandle) -> None:
        return

    def until(self, at: float) -> None:
        """Let the time pass and do what is due."""
        while self._calls and self._calls[0][0] <= at:
            when, _, handle = heapq.heappop(self._calls)
            self.at = max(self.at, when)
            if not handle.cancelled():
                handle._run()
        self.at = max(self.at, at)


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Time:
    made = Time()
    monkeypatch.setattr(repeated_log.asyncio, "get_running_loop", lambda: made)
    return made


def test_it_is_said_after_ten_seconds_a_minute_and_then_every_ten_minutes(time: Time) -> None:
    said: list[float] = []
    reminder = RepeatedLog(said.append)
    time.until(100)
    reminder.begin()
    time.until(100 + 2500)
    assert said == [10, 60, 600, 1200, 1800, 2400]


def test_nothing_is_said_of_what_is_over_and_the_next_time_begins_anew(time: Time) -> None:
    said: list[float] = []
    reminder = RepeatedLog(said.append)
    assert reminder.end() is None
    reminder.begin()
    time.until(30)
    assert reminder.end() == 30
    time.until(5000)
    assert said == [10]
    assert not reminder.active
    reminder.begin()
    time.until(5011)
    assert said == [10, 10]
