"""Input that is left waiting, so that one wake-up takes all of it."""

from __future__ import annotations

import asyncio
import socket

from commd.common.wakeup_coalescing import CoalescingLoop, postpone_input
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
