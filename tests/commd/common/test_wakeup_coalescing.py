"""Input that is left waiting, so that one wake-up takes all of it."""

import asyncio
import selectors
import socket
import time

import pytest

from commd.common.wakeup_coalescing import LAG_KEPT, CoalescingLoop, loop_lag, postpone_input
from tests.support.buses import until

POSTPONED = 2.0
"""Wall seconds."""


async def while_postponed() -> list[str]:
    """Return in order what happens when input waits that is postponed, and a timer sends more of it meanwhile."""
    loop, happened = asyncio.get_running_loop(), list[str]()
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)

    def read() -> None:
        while True:
            try:
                happened.append(ours.recv(10).decode())
            except BlockingIOError:
                return

    def send() -> None:
        happened.append("timer")
        theirs.send(b"b")

    with ours, theirs:
        theirs.send(b"a")
        loop.add_reader(ours, read)
        postpone_input(POSTPONED)
        loop.call_later(0.01, send)
        await until(lambda: "b" in happened, "both are read")
        loop.remove_reader(ours)
    return happened


def test_timers_are_on_time_while_input_is_postponed_and_one_pass_reads_all_of_it() -> None:
    with asyncio.Runner(loop_factory=CoalescingLoop) as runner:
        assert runner.run(while_postponed()) == ["timer", "a", "b"]


def test_another_loop_takes_input_as_it_comes() -> None:
    assert asyncio.run(while_postponed()) == ["a", "timer", "b"]


def test_a_loop_is_as_late_as_its_worst_pass_or_wait_of_the_last_second(monkeypatch: pytest.MonkeyPatch) -> None:
    now, sleeps_long = 100.0, 0.0

    def wait(self: object, timeout: float | None = None) -> list[object]:
        nonlocal now
        now += (timeout or 0.0) + sleeps_long
        return []

    monkeypatch.setattr(time, "monotonic", lambda: now)
    monkeypatch.setattr(selectors.DefaultSelector, "select", wait)

    async def lags() -> list[float]:
        nonlocal now, sleeps_long
        found = [loop_lag()]
        now += 3.0  # a pass in which nothing else is done
        found.append(loop_lag())
        await asyncio.sleep(LAG_KEPT / 2)
        found.append(loop_lag())
        for _ in range(5):
            await asyncio.sleep(LAG_KEPT / 2)
        found.append(loop_lag())
        sleeps_long = 0.5  # the machine does not run the process
        await asyncio.sleep(LAG_KEPT / 2)
        found.append(loop_lag())
        return found

    with asyncio.Runner(loop_factory=CoalescingLoop) as runner:
        assert runner.run(lags()) == pytest.approx([0.0, 3.0, 3.0, 0.0, 0.5])
    assert asyncio.run(no_lag()) == 0.0, "other loops do not measure"


async def no_lag() -> float:
    return loop_lag()
