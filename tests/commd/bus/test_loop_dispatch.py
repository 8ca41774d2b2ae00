"""What comes on other threads is handed to the event loop in its order, together, and with a turn behind it."""

import asyncio
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from commd.bus import loop_dispatch as module
from commd.bus.loop_dispatch import AT_ONCE, TURN, LoopDispatch
from tests.support.buses import Connect, until


def dispatch() -> tuple[LoopDispatch, list[Any]]:
    """What hands over to the running loop, and a list of what is heard."""
    return LoopDispatch(asyncio.get_running_loop(), Counter()), []


async def passes(until: Callable[[], bool]) -> None:
    """Let the loop go through its callbacks again and again until something holds."""
    while not until():
        await asyncio.sleep(0)


async def test_things_from_several_threads_come_in_their_order_and_all_of_them() -> None:
    handover, heard = dispatch()

    def put(who: int) -> None:
        for number in range(1000):
            handover.put(heard.append, (who, number))

    threads = [threading.Thread(target=put, args=(who,)) for who in range(4)]
    for thread in threads:
        thread.start()
    await until(lambda: len(heard) == 4000, "all of them come")
    for who in range(4):
        assert [number for one, number in heard if one == who] == list(range(1000))


@pytest.mark.parametrize(("each", "at_once"), [(TURN, AT_ONCE), (TURN / 500, 500), (0.0, 1000)])
async def test_what_fits_into_a_turn_is_handed_over_and_others_have_theirs_in_between(
    each: float, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    passed = [0.0]
    monkeypatch.setattr(module, "monotonic", lambda: passed[0])
    handover, heard = dispatch()

    def hear(item: int) -> None:
        heard.append(item)
        passed[0] += each

    for number in range(1000):
        handover.put(hear, number)
    asyncio.get_running_loop().call_soon(heard.append, "another")
    await passes(lambda: len(heard) == 1001)
    assert heard.index("another") == pytest.approx(at_once, abs=1), "a turn takes a fiftieth of a second"
    assert [one for one in heard if one != "another"] == list(range(1000))


async def test_who_is_told_of_something_has_a_turn_behind_the_rest_in_the_same_pass() -> None:
    handover, heard = dispatch()

    def hear(item: int) -> None:
        heard.append(item)
        if item == 0:
            handover.afterwards(lambda: heard.append("turn"))

    for number in range(3):
        handover.put(hear, number)
    asyncio.get_running_loop().call_soon(heard.append, "next")
    await passes(lambda: len(heard) == 5)
    handover.afterwards(lambda: heard.append("soon"))
    await asyncio.sleep(0)
    assert heard == [0, 1, 2, "turn", "next", "soon"]


@pytest.mark.parametrize("error", [ValueError("wrong"), asyncio.CancelledError("wrong")])
async def test_a_defect_is_told_and_keeps_nobody_else_from_theirs(error: BaseException) -> None:
    (handover, heard), told = dispatch(), list[str]()
    asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(repr(context["exception"])))

    def fails(item: Any) -> None:
        handover.afterwards(lambda: heard.append("turn"))
        raise error

    handover.put(fails, "wrong")
    handover.put(heard.append, "right")
    await passes(lambda: len(heard) == 2)
    assert (heard, told) == (["right", "turn"], [repr(error)])


def test_a_handler_that_reads_a_cancelled_future_or_ends_the_program_keeps_nobody_from_theirs() -> None:
    heard, told = list[Any](), list[str]()

    async def hear(ends: type[BaseException]) -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: told.append(repr(context["exception"])))
        handover = LoopDispatch(loop, Counter())

        def fails(item: str) -> None:
            raise ends(item)

        handover.put(fails, "ended")
        handover.put(heard.append, "before")
        try:
            await asyncio.sleep(0)
        finally:
            handover.put(heard.append, "behind")
            await asyncio.sleep(0)

    asyncio.run(hear(asyncio.CancelledError))
    with pytest.raises(SystemExit):
        asyncio.run(hear(SystemExit))
    assert heard == ["before", "behind"] * 2
    assert told == ["CancelledError('ended')"]


def test_what_comes_after_a_loop_that_was_called_and_has_ended_is_counted() -> None:
    counters, loop = Counter[str](), asyncio.new_event_loop()
    handover = LoopDispatch(loop, counters)
    handover.put(print, "too late")
    loop.close()
    for _ in range(10):
        handover.put(print, "lost")
    assert counters == {"dropped": 11}


async def test_a_thread_of_zenohs_has_one_state_in_the_interpreter_for_all_its_calls(connect: Connect) -> None:
    here, there = await connect("a"), await connect("b")
    of_thread, calls = threading.local(), list[int]()

    def arrived(sample: zenoh.Sample) -> None:
        of_thread.calls = getattr(of_thread, "calls", 0) + 1  # goes with the state
        here._dispatch.put(calls.append, of_thread.calls)

    here.raw.tap("x/y", arrived)
    publisher = there.raw.publisher("x/y")
    await until(lambda: publisher.matching, "the subscriber is known")
    for number in range(50):
        publisher.put(b"", "text/plain")
        await until(lambda so_far=number: len(calls) > so_far, "it has arrived")  # type: ignore[misc]
    assert max(calls) >= 50 / module.KEPT
    assert len(module._kept) <= module.KEPT


@pytest.mark.parametrize(
    ("takes", "order"), [(TURN / 2, ["meanwhile", "another"]), (2 * TURN, ["another", "meanwhile"])]
)
async def test_what_arrives_during_a_turn_is_handed_over_in_the_same_pass_unless_the_turn_was_long(
    takes: float, order: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    passed = [0.0]
    monkeypatch.setattr(module, "monotonic", lambda: passed[0])
    handover, heard = dispatch()

    def turn() -> None:
        passed[0] += takes
        handover.put(heard.append, "meanwhile")

    handover.put(lambda _: handover.afterwards(turn), None)
    asyncio.get_running_loop().call_soon(heard.append, "another")
    await passes(lambda: len(heard) == 2)
    assert heard == order
