"""What a board tells of its clock, its disk and its links: real routers, linked over loopback."""

import asyncio
import time
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

from commd.bus.bus import Bus
from commd.bus.errors import QueryFailed, QueryTimeout
from commd.router import self_check
from commd.router.self_check import FILLER, SelfCheck, measure, measure_all, room
from schemas.wire import keys
from schemas.wire.records import BoardReport, Checkup
from tests.support.buses import FLEET, Connect, served, session, until
from tests.support.ports import free_port

AHEAD = 3600.0


async def pair(stack: AsyncExitStack, folder: Path) -> tuple[Bus, Bus]:
    """Two boards, the routers of which are linked."""
    link = f"tcp/127.0.0.1:{free_port()}"

    def router(name: str, **links: list[str]) -> AbstractAsyncContextManager[Bus]:
        return session(f"tcp/127.0.0.1:{free_port()}", name, "commd", router=True, **links)

    one = await stack.enter_async_context(router("pi1", listen=[link]))
    two = await stack.enter_async_context(router("pi2", connect=[link]))
    for bus, name in ((one, "pi1"), (two, "pi2")):
        SelfCheck(bus, name, ["pi1", "pi2"], folder)
    for bus, other in ((one, "pi2"), (two, "pi1")):
        await until(partial(answered, bus, other), f"{other} answers")
    return one, two


async def answered(bus: Bus, board: str) -> bool:
    """Whether a board answers a query of another board."""
    try:
        await bus.ask_one(keys.checkup(FLEET, board), Checkup(), BoardReport, 20)
    except QueryTimeout:  # the router has no route to it yet
        return False
    return True


async def test_a_board_measures_clocks_and_links_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(time_ns=lambda: time.time_ns() + int(AHEAD * 1e9))
    monkeypatch.setattr(self_check, "time", clock)  # of the board that measures
    async with asyncio.timeout(240), AsyncExitStack() as stack:
        one, _ = await pair(stack, tmp_path)
        report = await one.ask_one(keys.checkup(FLEET, "pi2"), Checkup(links=True), BoardReport, 20)
        assert (report.board, report.state) == ("pi2", str(tmp_path))
        assert report.disk_size is not None
        assert report.disk_free is not None
        assert 0 <= report.disk_free <= report.disk_size
        (link,) = report.links
        assert (link.board, link.problem) == ("pi1", "")
        assert 1 <= link.answered <= link.asked
        assert link.ahead is not None
        assert link.round_trip is not None
        assert abs(link.ahead + AHEAD) <= link.round_trip / 2 + 0.05
        simple = await one.ask_one(keys.checkup(FLEET, "pi2"), Checkup(), BoardReport, 20)
        assert (simple.links, simple.disk_free) == ((), None), "who only wants the clock loads nothing"


def test_a_slow_link_shows_its_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    async def slow(bus: Bus, board: str, filler: str, timeout: float) -> tuple[float, float]:
        return 0.02 + len(filler) / 100_000, 0.5

    monkeypatch.setattr(self_check, "_round_trip", slow)
    report = asyncio.run(measure(None, "pi2"))  # type: ignore[arg-type]
    assert report.rate == pytest.approx(100_000)
    assert (report.round_trip, report.slowest, report.ahead) == (0.02, 0.02, 0.5)


def test_a_link_that_loses_some_round_trips_and_the_filler_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    tries = iter((0.5, None, 0.1, None, 0.3))

    async def lossy(bus: Bus, board: str, filler: str, timeout: float) -> tuple[float, float]:
        took = None if filler else next(tries)
        if took is None:
            raise QueryTimeout(board, timeout)
        return took, took / 10

    monkeypatch.setattr(self_check, "_round_trip", lossy)
    report = asyncio.run(measure(None, "pi2"))  # type: ignore[arg-type]
    assert (report.answered, report.asked, report.round_trip, report.slowest) == (3, 5, 0.1, 0.5)
    assert report.ahead == pytest.approx(0.01), "the fastest tells the clock best"
    assert report.problem == f"{FILLER} bytes: no answer within 4 s"


async def test_a_board_that_nobody_speaks_for_is_told_at_once_and_none_is_waited_for_beyond_the_bound(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    (report,) = await measure_all(await connect(), ["nobody"])
    assert (report.answered, report.problem) == (0, "nobody answers")

    async def never(*_: object) -> tuple[float, float]:
        await asyncio.Event().wait()
        raise AssertionError

    monkeypatch.setattr(self_check, "_round_trip", never)
    reports = await measure_all(await connect("y"), ["pi1", "pi2"], 0.1)
    assert [one.problem for one in reports] == ["not measured within 0.1 s"] * 2


async def test_an_unreadable_or_too_large_question_is_refused_in_words(connect: Connect, tmp_path: Path) -> None:
    SelfCheck(await connect("pi1", "commd"), "pi1", ["pi1"], tmp_path)
    backfill = await connect("asker")
    await served(backfill, keys.checkup(FLEET, "pi1"))
    with pytest.raises(QueryFailed, match="expected at most 65536"):
        await backfill.ask_one(keys.checkup(FLEET, "pi1"), Checkup(filler="x" * 100_000), BoardReport, 10)


def test_the_room_of_a_folder_that_is_not_there_is_not_known(tmp_path: Path) -> None:
    assert asyncio.run(room(tmp_path / "no")) == (None, None)
