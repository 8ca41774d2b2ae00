"""Questions to several boards at once: each one ends, whatever becomes of the boards."""

import asyncio
from collections.abc import Callable
from contextlib import aclosing
from pathlib import Path
from unittest.mock import Mock

import pytest

from argosy.cli.fleet_bus import Boards, FleetBus
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.common.tasks import Tasks
from schemas.mission.model import read_mission
from schemas.wire.records import Header, Health, Mailboxes
from tests.support.buses import until


def asked(monkeypatch: pytest.MonkeyPatch, *, opening: Exception | None = None, asking: Exception) -> list[str]:
    """Ask two boards, of which one is not reached for `opening`, and the other one fails; return what is said."""
    bus, boards = object.__new__(FleetBus), object.__new__(Boards)
    bus.boards, bus.name, boards.homes = boards, "ops", {}
    boards.why_unseen, boards.work = lambda *_: "", Tasks("asking")

    async def opened() -> FleetBus:
        if opening is not None:
            raise opening
        return bus

    monkeypatch.setattr(Bus, "ask", Mock(side_effect=asking))

    async def body() -> list[str]:
        boards.opening = {"pi1": asyncio.create_task(opened()), "pi2": asyncio.create_task(opened())}
        async with aclosing(bus.query("argosy/f/*/mailboxes", None, Mailboxes, 1.0)) as replies:
            return [reply.error async for reply in replies]

    return asyncio.run(asyncio.wait_for(body(), 240))


def test_a_session_that_closes_while_it_is_asked_is_told_for_each_board(monkeypatch: pytest.MonkeyPatch) -> None:
    said = asked(monkeypatch, asking=BusClosed("session closed"))
    assert said == [f"board {board} is no longer reached: session closed" for board in ("pi1", "pi2")]


def test_a_defect_while_boards_are_asked_is_their_answer_and_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asking = UnicodeError("label too long")
    assert asked(monkeypatch, asking=asking) == ["defect in argosy: UnicodeError: label too long"] * 2
    opening = asked(monkeypatch, opening=UnicodeError("host"), asking=AssertionError())
    assert opening == ["defect in argosy: UnicodeError: host"] * 2


class Heard:
    """What a fleet's bus takes from two boards, of which `pi2` is reached at the second attempt."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("argosy.cli.fleet_bus.DIAL_AGAIN", 0.0)
        self.bus, self.at_pi2 = object.__new__(FleetBus), object.__new__(FleetBus)
        self.taken: list[Callable[..., None]] = []
        """What each board calls, as its session is declared to."""
        monkeypatch.setattr(Bus, "watch", lambda _, __, handler: self.taken.append(handler))
        monkeypatch.setattr(Bus, "subscribe", lambda _, __, ___, handler: self.taken.append(handler))

    async def listen(self, declare: Callable[[FleetBus], None]) -> None:
        """Declare something, and wait until both boards know."""
        boards = self.bus.boards = Boards(read_mission("mission: m\nagents: {a: {program: a.asl}}\n", Path("m.yaml")))

        async def opened(bus: FleetBus | None) -> FleetBus:
            if bus is None:
                raise BusClosed("nobody listens there")
            return bus

        boards.dial = lambda _: asyncio.create_task(opened(self.at_pi2))
        boards.opening = {board: asyncio.create_task(opened(bus)) for board, bus in (("pi1", self.bus), ("pi2", None))}
        assert await boards.unreached() == {"pi2": "nobody listens there"}
        declare(self.bus)
        await until(lambda: len(self.taken) >= 2, "both are taken")
        await boards.work.end()


def test_a_token_is_there_until_no_board_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    heard, told = Heard(monkeypatch), list[tuple[str, bool]]()
    asyncio.run(heard.listen(lambda bus: bus.watch("argosy/f/*/alive/**", lambda *one: told.append(one))))
    one, two = heard.taken
    for at, token, alive in (
        (one, "a", True),
        (two, "a", True),
        (two, "b", True),
        (one, "a", False),
        (two, "a", False),
    ):
        at(token, alive)
    assert told == [("a", True), ("b", True), ("a", False)]


def test_what_comes_by_two_boards_is_heard_once(monkeypatch: pytest.MonkeyPatch) -> None:
    heard, told = Heard(monkeypatch), list[tuple[str, int]]()
    take = "argosy/f/r1/health/bridged"
    asyncio.run(heard.listen(lambda bus: bus.subscribe(take, Health, lambda _, one: told.append(told_by(one)))))
    one, two = heard.taken
    for at, boot, seq in ((one, "x", 1), (two, "x", 1), (two, "x", 2), (one, "x", 2), (one, "y", 1), (two, "y", 1)):
        at(take, Health(header=Header(boot=boot, seq=seq)))
    assert told == [("x", 1), ("x", 2), ("y", 1)]


def told_by(health: Health) -> tuple[str, int]:
    return health.header.boot, health.header.seq
