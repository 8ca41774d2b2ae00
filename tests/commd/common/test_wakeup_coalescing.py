"""Input that is left waiting, so that one wake-up takes all of it."""

from __future__ import annotations

import asyncio
import socket

from commd.common.wakeup_coalescing import CoalescingLoop, postpone_input
from tests.support.buses import until


async def while_postponed(seconds: float) -> list[str]:
    """Postpone input, let two datagrams arrive meanwhile, and return what happened in order."""
    loop, happened = asyncio.get_running_loop(), list[str]()
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)

    def read() -> None:
        while True:
            try:
                happened.append(ours.recv(10).decode())
            except BlockingIOError:
                happened.append("read empty")
                return

    def send(text: str) -> None:
        happened.append(f"sent {text}")
        theirs.send(text.encode())

    with ours, theirs:
        loop.add_reader(ours, read)
        await asyncio.sleep(0)
        postpone_input(seconds)
        loop.call_later(0.01, send, "a")
        loop.call_later(0.02, send, "b")
        await until(lambda: "b" in happened, "both are read")
        loop.remove_reader(ours)
    return happened


def test_timers_are_on_time_while_input_is_postponed_and_one_pass_reads_all_of_it() -> None:
    with asyncio.Runner(loop_factory=CoalescingLoop) as runner:
        happened = runner.run(while_postponed(0.3))
    assert happened == ["sent a", "sent b", "a", "b", "read empty"]


def test_another_loop_takes_input_as_it_comes() -> None:
    assert asyncio.run(while_postponed(3600))[:3] == ["sent a", "a", "read empty"]
