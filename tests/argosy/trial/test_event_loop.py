"""The event loop of a trial: virtual time, its order, its end, and UDP within the process."""

import asyncio
import signal
import time
from collections.abc import Callable, Coroutine, Iterator
from threading import get_ident
from types import SimpleNamespace
from typing import Any

import pytest

from argosy.trial.event_loop import Deadlock, VirtualLoop
from commd.common.tasks import wait_at_most

HERE, THERE = ("127.0.0.1", 14550), ("127.0.0.1", 14551)


@pytest.fixture
def loop() -> Iterator[VirtualLoop]:
    made = VirtualLoop()
    yield made
    for task in asyncio.all_tasks(made):
        task._log_destroy_pending = False  # type: ignore[attr-defined]  # those of dead processes wait for ever
    made.close()


class Received(asyncio.DatagramProtocol):
    """Keeps what arrives at a UDP socket."""

    def __init__(self) -> None:
        self.got: list[object] = []

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.got.append((data, addr))

    def error_received(self, exc: Exception) -> None:
        self.got.append(type(exc).__name__)


def test_who_waits_by_a_clock_that_differs_by_rounding_does_not_wait_for_ever(loop: VirtualLoop) -> None:
    start = 0.1
    due = 32.0 - start + 4e-15

    async def wait() -> int:
        tries = 0
        while (left := due - (loop.time() - start)) > 0:
            tries += 1
            assert tries < 5, "the time stands still"
            await asyncio.sleep(left)
        return tries

    assert loop.run_until_complete(wait()) > 1, "the first wait ends early"


def test_a_timeout_that_rounding_makes_the_present_time_ends(loop: VirtualLoop) -> None:
    async def wait() -> None:
        await asyncio.sleep(1000.0)
        due = loop.time() + 1e-12
        while loop.time() < due:
            await wait_at_most(asyncio.Event(), 1e-14)

    loop.run_until_complete(wait())
    assert 1000.0 < loop.time() < 1000.001


def test_no_timer_runs_before_its_time_however_near_another_one_is(loop: VirtualLoop) -> None:
    seen: list[float] = []
    for when in (51.4 - 1e-10, 51.4):
        loop.call_at(when, lambda: seen.append(loop.time()))
    loop.call_at(51.5, loop.stop)
    loop.run_forever()
    assert seen[-1] >= 51.4


def test_hours_of_sleep_and_timeouts_pass_without_waiting(loop: VirtualLoop) -> None:
    async def day() -> list[float]:
        await asyncio.sleep(3600)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(7200):
                await asyncio.sleep(100_000)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(loop.create_future(), 0.25)
        return [loop.time(), asyncio.get_running_loop().time()]

    begun = time.monotonic()
    assert loop.run_until_complete(day()) == [10_800.25, 10_800.25]
    assert time.monotonic() - begun < 60


def test_timers_for_one_time_run_in_the_order_in_which_they_were_set(loop: VirtualLoop) -> None:
    order: list[int] = []

    async def set_and_wait() -> None:
        for number in range(50):
            loop.call_at(5.0, order.append, number)
            loop.call_later(1 + number / 100, int)  # others change the shape of the heap
        await asyncio.sleep(6)

    loop.run_until_complete(set_and_wait())
    assert order == list(range(50))


def test_a_timer_never_runs_before_its_time(loop: VirtualLoop) -> None:
    late: list[float] = []

    async def wait() -> None:
        for number in range(1, 200):
            loop.call_at(number / 7, lambda due=number / 7: late.append(loop.time() - due))
        await asyncio.sleep(60)

    loop.run_until_complete(wait())
    assert len(late) == 199
    assert -1e-9 <= min(late) <= max(late) < 1e-6


def test_a_cancelled_timer_does_not_run(loop: VirtualLoop) -> None:
    ran: list[str] = []

    async def wait() -> None:
        loop.call_later(1, ran.append, "cancelled").cancel()
        loop.call_later(1, ran.append, "kept")
        await asyncio.sleep(2)

    loop.run_until_complete(wait())
    assert ran == ["kept"]


def test_a_wait_that_nothing_can_end_is_a_deadlock(loop: VirtualLoop) -> None:
    async def wait() -> None:
        await asyncio.sleep(12.5)
        await asyncio.Event().wait()

    with pytest.raises(Deadlock, match=r"^at 12\.500 s of virtual time everything waits, and no timer is set$"):
        loop.run_until_complete(wait())


def test_work_of_an_executor_is_done_in_this_thread_and_its_error_is_raised(loop: VirtualLoop) -> None:
    async def work() -> tuple[int, int]:
        with pytest.raises(ZeroDivisionError):
            await loop.run_in_executor(None, lambda: 1 // 0)
        cancelled = loop.run_in_executor(None, pytest.fail, "cancelled before")
        cancelled.cancel()
        return await asyncio.to_thread(get_ident), await loop.run_in_executor(None, get_ident)

    assert loop.run_until_complete(work()) == (get_ident(), get_ident())


def test_a_signal_handler_is_that_of_the_present_process(loop: VirtualLoop) -> None:
    process = SimpleNamespace(dead=False, handlers={})
    loop.owner.set(process)
    called: list[str] = []
    loop.add_signal_handler(signal.SIGTERM, called.append, "stop")
    process.handlers[signal.SIGTERM]()
    assert called == ["stop"]
    assert loop.remove_signal_handler(signal.SIGTERM)
    assert not loop.remove_signal_handler(signal.SIGTERM)


def with_two_sockets(
    loop: VirtualLoop, play: Callable[[Any, Any], Coroutine[Any, Any, None]]
) -> tuple[list[object], list[object]]:
    """Play with a server's and a client's transport; return what each has received."""

    async def whole() -> tuple[list[object], list[object]]:
        serving, server = await loop.create_datagram_endpoint(Received, local_addr=HERE)
        asking, client = await loop.create_datagram_endpoint(Received, local_addr=THERE, remote_addr=HERE)
        await play(serving, asking)
        await asyncio.sleep(1)
        return server.got, client.got

    return loop.run_until_complete(whole())


def test_datagrams_arrive_with_their_sender_after_the_delay_of_the_network(loop: VirtualLoop) -> None:
    loop.delay = lambda sender, receiver: 0.25 if sender == THERE else 0.75

    async def play(serving: Any, asking: Any) -> None:
        asking.sendto(b"one")
        asking.sendto(b"two", HERE)
        serving.sendto(b"answer", THERE)
        for transport, seconds in ((serving, 0.25), (asking, 0.75)):
            received = transport.get_protocol().got
            await asyncio.sleep(seconds - loop.time() - 0.01)
            assert received == []
            await asyncio.sleep(0.02)
            assert received != []

    got, answered = with_two_sockets(loop, play)
    assert got == [(b"one", THERE), (b"two", THERE)]
    assert answered == [(b"answer", HERE)]


def test_a_datagram_is_lost_when_the_network_says_so(loop: VirtualLoop) -> None:
    loop.delay = lambda sender, receiver: None if sender == THERE else 0.1

    async def play(serving: Any, asking: Any) -> None:
        asking.sendto(b"lost")
        serving.sendto(b"not lost", THERE)

    assert with_two_sockets(loop, play) == ([], [(b"not lost", HERE)])


def test_a_datagram_to_an_address_without_a_socket_is_refused_to_a_connected_sender(loop: VirtualLoop) -> None:
    async def play(serving: Any, asking: Any) -> None:
        serving.close()
        await asyncio.sleep(0)
        asking.sendto(b"?")

    assert with_two_sockets(loop, play) == ([], ["ConnectionRefusedError"])


def test_a_connected_socket_takes_nothing_from_others(loop: VirtualLoop) -> None:
    async def play(serving: Any, asking: Any) -> None:
        stranger, _ = await loop.create_datagram_endpoint(Received, local_addr=("127.0.0.1", 0xBAD))
        stranger.sendto(b"spoofed", THERE)
        stranger.sendto(b"asked", HERE)

    assert with_two_sockets(loop, play) == ([(b"asked", ("127.0.0.1", 0xBAD))], [])


def test_an_address_is_taken_until_its_socket_is_closed(loop: VirtualLoop) -> None:
    async def play(serving: Any, asking: Any) -> None:
        with pytest.raises(OSError, match="Address already in use") as taken:
            await loop.create_datagram_endpoint(Received, local_addr=HERE)
        assert taken.value.errno == 98
        serving.close()
        assert serving.is_closing()
        again, _ = await loop.create_datagram_endpoint(Received, local_addr=HERE)
        assert again.get_extra_info("sockname") == HERE

    with_two_sockets(loop, play)


def test_nothing_of_a_dead_process_runs_and_what_it_has_sent_arrives(loop: VirtualLoop) -> None:
    process = SimpleNamespace(dead=False)
    ran: list[str] = []

    async def doomed(asking: Any) -> None:
        loop.owner.set(process)
        loop.call_later(0.5, ran.append, "timer before")
        loop.call_later(1.5, ran.append, "timer after")
        asking.sendto(b"last words")
        try:
            await asyncio.sleep(1.5)
        finally:
            ran.append("cleaned up")

    async def play(serving: Any, asking: Any) -> None:
        task = asyncio.create_task(doomed(asking))
        await asyncio.sleep(0.0001)
        loop.call_later(0.9, setattr, process, "dead", True)
        await asyncio.sleep(3)
        ran.append("alive")
        assert not task.done()

    got, _ = with_two_sockets(loop, play)
    assert ran[:2] == ["timer before", "alive"]
    assert got == [(b"last words", THERE)]


def test_a_datagram_for_a_dead_process_is_lost(loop: VirtualLoop) -> None:
    async def play(serving: Any, asking: Any) -> None:
        asking.sendto(b"too late")
        serving.free()

    assert with_two_sockets(loop, play) == ([], ["ConnectionRefusedError"])
