"""The directories of several boards: real routers, real files, real mail."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, aclosing, asynccontextmanager, suppress
from pathlib import Path
from sqlite3 import Connection

import pytest

from commd.bus.bus import Bus, Query, open_bus
from commd.bus.errors import QueryTimeout
from commd.client import join
from commd.common.clock import Clock
from commd.directory import service as directory_module
from commd.directory.service import Directory, open_directory
from commd.mail.service import MailService, open_mail_service
from commd.mail.store import Store, StoreFailed
from schemas.mission.model import read_mission
from schemas.wire import keys
from schemas.wire.records import BoardServices, Header, Mail, Message, Receipt, Refusal, ServiceRequest
from schemas.wire.terms import Atom, Structure
from tests.commd.offices import message, post
from tests.support.buses import FLEET, session, subscribed, under_way, until
from tests.support.notes import identities

MISSION = """\
mission: fleet
boards:
  pi1: {}
  pi2: {}
agents:
  a: {program: a.asl, board: pi1}
  b: {program: b.asl, board: pi2}
  c: {program: c.asl, board: pi1}
"""


class Fleet:
    """Two boards: pi1 listens, pi2 dials. Each is started and ended as a test wants it."""

    def __init__(self, folder: Path, port: Callable[[], int]) -> None:
        self.mission = read_mission(MISSION, Path("m.yaml"))
        self.link = f"tcp/127.0.0.1:{port()}"
        self.endpoints = {board: f"tcp/127.0.0.1:{port()}" for board in ("pi1", "pi2")}
        self._folder = folder

    @asynccontextmanager
    async def board(self, name: str) -> AsyncIterator[Directory]:
        """A board's commd, without its process."""
        listen, connect = ([self.link], []) if name == "pi1" else ([], [self.link])
        async with (
            session(self.endpoints[name], name, "commd", router=True, listen=listen, connect=connect) as bus,
            open_mail_service(bus, self.mission.mailboxes, self.mission.mail, self._folder) as mail_service,
        ):
            await bus.claim(name)
            clock = Clock()
            async with (
                open_directory(bus, name, self.mission, mail_service, clock) as directory,
                under_way(directory.run()),
            ):
                yield directory

    @asynccontextmanager
    async def agent(self, name: str, board: str) -> AsyncIterator[Agent]:
        """An agent's daemon, as far as the directory sees it."""
        async with session(self.endpoints[board], name) as bus:
            await bus.claim(name)
            yield Agent(bus, name, board)


class Agent:
    """Asks the directory of its board, and takes its mail."""

    def __init__(self, bus: Bus, name: str, board: str) -> None:
        self.bus, self.name, self.board = bus, name, board
        self.mail: list[Message] = []
        bus.serve(keys.inbox(FLEET, name), Mail, self._take)

    async def _take(self, query: Query[Mail]) -> None:
        self.mail += query.record.messages
        query.reply(Receipt(taken=len(query.record.messages)))

    async def ask(self, do: str, service: str = "", agent: str = "", stays: bool = False) -> BoardServices:
        request = ServiceRequest(agent=agent or self.name, do=do, service=service, stays=stays)  # type: ignore[arg-type]
        async with asyncio.timeout(120):
            while True:
                key = keys.service_requests(FLEET, self.board, request.agent)
                with suppress(QueryTimeout):
                    return await self.bus.ask_one(key, request, BoardServices, 10)
                await asyncio.sleep(0.02)

    @property
    def told(self) -> list[tuple[str, object]]:
        """Its notices, each once: sender and content."""
        return list(dict.fromkeys((one.sender, one.content) for one in self.mail))


def provider(agent: str, service: str) -> tuple[str, object]:
    return "df", Structure("provider", (Atom(agent), service))


@pytest.fixture
def fleet(tmp_path: Path, free_port: Callable[[], int]) -> Fleet:
    return Fleet(tmp_path, free_port)


async def test_a_service_is_found_and_told_of_on_the_other_board(fleet: Fleet) -> None:
    async with fleet.board("pi1"), fleet.board("pi2"), fleet.agent("a", "pi1") as a, fleet.agent("b", "pi2") as b:
        assert (await a.ask("subscribe", "cook")).found == ()
        assert (await b.ask("register", "cook")).problem == ""
        await until(lambda: a.told == [provider("b", "cook")], "a is told of b")
        assert (await a.ask("search", "cook")).found == ("b",)
        await a.ask("register", "cook")
        await until(lambda: a.told == [provider("b", "cook"), provider("a", "cook")], "a is told of itself")
        await b.ask("deregister", "cook")
        await until_found(a, "cook", ("a",))


@pytest.mark.parametrize(("boot", "mail_time"), [("x", math.inf), ("x", math.nan), ("y" * 4_000_000, 1.0)])
async def test_a_board_with_an_endless_clock_or_name_of_its_life_spoils_no_other_directory(
    boot: str, mail_time: float, fleet: Fleet
) -> None:
    """pi1 keeps what it has seen of pi2's clock, and passes it on with its own record, as JSON."""
    async with fleet.board("pi1") as pi1, fleet.agent("a", "pi1") as a:
        async with open_bus(fleet.link, fleet=FLEET, name="pi2", daemon="commd", wire="msgpack") as attacker:
            record = BoardServices(header=Header(boot=boot, seq=1), board="pi2", version=1, mail_time=mail_time)
            attacker.put(keys.services(FLEET, "pi2"), record)
            heard = pi1._bus.counters
            await until(lambda: "pi2" in pi1.services.others or heard["bad_input"] == 1, "it is taken or refused")
        assert (await a.ask("search", "cook")).mail_seen == {}


async def until_found(agent: Agent, service: str, expected: tuple[str, ...]) -> None:
    async def found() -> bool:
        return (await agent.ask("search", service)).found == expected

    await until(found, f"{service}: {expected}")


async def test_who_joins_one_board_is_known_on_the_other_until_it_leaves(fleet: Fleet) -> None:
    async with fleet.board("pi1") as pi1, fleet.board("pi2") as pi2, fleet.agent("kid", "pi2") as kid:
        assert pi1.services.homes().get("kid") is None
        assert (await kid.ask("join")).problem == ""
        await until(lambda: pi1.services.homes().get("kid") == "pi2", "pi1 knows kid")
        assert list(pi1.services.homes()) == list(pi2.services.homes()) == ["a", "b", "c", "kid"]
        async with fleet.agent("a", "pi1") as a:
            answer = await a.ask("join", agent="kid")
            assert answer.problem == "the name `kid` is taken on board pi2"
        await kid.ask("leave")
        await until(lambda: pi1.services.homes().get("kid") is None, "pi1 has forgotten kid")


async def test_what_is_known_of_a_board_outlives_its_absence_and_our_own_restart(fleet: Fleet) -> None:
    async with fleet.board("pi1") as pi1, AsyncExitStack() as there:
        await there.enter_async_context(fleet.board("pi2"))
        kid = await there.enter_async_context(fleet.agent("kid", "pi2"))
        await kid.ask("join")
        await kid.ask("register", "cook")
        await until(lambda: pi1.services.providers("cook") == ("kid",), "pi1 knows what kid offers")
    async with fleet.board("pi1") as pi1, fleet.agent("a", "pi1") as a:
        assert pi1.services.homes().get("kid") == "pi2"
        assert (await a.ask("search", "cook")).found == ("kid",)
        async with fleet.board("pi2") as pi2, fleet.agent("kid", "pi2") as kid:
            assert pi2.services.homes().get("kid") == "pi2", "it has not left"
            await kid.ask("leave")
            await until(lambda: pi1.services.homes().get("kid") is None, "pi1 hears that kid has left")


async def test_a_subscriber_is_told_once_of_what_began_while_the_boards_did_not_see_each_other(fleet: Fleet) -> None:
    async with fleet.board("pi1"), fleet.agent("a", "pi1") as a:
        await a.ask("subscribe", "cook")
        async with fleet.board("pi2"), fleet.agent("b", "pi2") as b:
            await b.ask("register", "cook")
            await until(lambda: a.told == [provider("b", "cook")], "a is told of b")
    async with fleet.board("pi2"), fleet.agent("b", "pi2") as b:
        await b.ask("register", "sing")
        async with fleet.board("pi1") as pi1, fleet.agent("a", "pi1") as a:
            await until(lambda: pi1.services.providers("sing") == ("b",), "pi1 hears of the new service")
            await a.ask("subscribe", "sing")
            await until(lambda: provider("b", "sing") in a.told, "a is told of it")
            assert a.told == [provider("b", "sing")], "and not again of what it had been told of"


async def test_who_joined_and_was_killed_is_forgotten_after_a_while_and_who_comes_back_is_not(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(directory_module, "LOOK_EVERY", 0.1)
    async with fleet.board("pi1") as pi1:
        async with (
            fleet.agent("kid", "pi1") as kid,
            fleet.agent("twin", "pi1") as twin,
            fleet.agent("stays", "pi1") as stays,
        ):
            await kid.ask("join")
            await twin.ask("join")
            await stays.ask("join", stays=True)
        async with fleet.agent("twin", "pi1"):
            await until(lambda: "twin" not in pi1._absent, "twin is seen")
            monkeypatch.setattr(directory_module, "FORGOTTEN_AFTER", 0.0)
            await until(lambda: pi1.services.homes().get("kid") is None, "kid is forgotten")
            assert (pi1.services.homes().get("twin"), pi1.services.homes().get("stays")) == ("pi1", "pi1")


async def test_a_program_beside_us_asks_once_and_hears_of_all_boards_also_of_those_away(fleet: Fleet) -> None:
    async with fleet.board("pi1") as pi1, fleet.agent("a", "pi1") as a:
        async with fleet.board("pi2"), fleet.agent("kid", "pi2") as kid:
            await kid.ask("join")
            await until(lambda: pi1.services.homes().get("kid") == "pi2", "pi1 knows kid")
        said: dict[str, object] = {}
        key = keys.services(FLEET, "pi1")
        await a.bus.ask_all(key, BoardServices, 10, lambda _, told: said.update({told.board: told.agents}))
        assert said == {"pi1": {"a": (), "c": ()}, "pi2": {"b": (), "kid": ()}}


async def test_whoever_asks_all_boards_at_once_hears_each_of_itself(fleet: Fleet) -> None:
    async with fleet.board("pi1") as pi1, fleet.board("pi2"), fleet.agent("a", "pi1") as a:
        await until(lambda: "pi2" in pi1.services.others, "the boards see each other")
        everybody = keys.services(FLEET, "*")
        boards: list[str] = []
        await a.bus.ask_all(everybody, BoardServices, 10, lambda _, told: boards.append(told.board))
        assert sorted(boards) == ["pi1", "pi2"]
        request = ServiceRequest(agent="a", do="register", service="cook")
        async with aclosing(a.bus.query(everybody, request, BoardServices, 10)) as replies:
            assert {reply.error async for reply in replies} == {"expected a concrete key: a request is for one board"}


async def test_what_cannot_be_done_is_answered_with_the_reason(fleet: Fleet) -> None:
    async with fleet.board("pi1"), fleet.agent("a", "pi1") as a:
        assert (await a.ask("register", "cook", "b")).problem == "`b` is no agent of board pi1 but of pi2"
        assert (await a.ask("register", "")).problem.startswith("expected the name of a service")


async def test_two_boards_of_one_name_are_told_of(fleet: Fleet, tmp_path: Path, free_port: Callable[[], int]) -> None:
    other = Fleet(tmp_path / "other", free_port)
    other.link = fleet.link
    other.endpoints["pi2"] = f"tcp/127.0.0.1:{free_port()}"
    async with fleet.board("pi2") as pi2, other.board("pi2"):
        async with fleet.board("pi1"):
            await until(lambda: identities(pi2.notes()) == [("board_twice", "")], "both are seen")
        await until(lambda: pi2.notes() == (), "they do not see each other any more")


async def test_an_unreadable_directory_does_not_begin_empty(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(directory_module, "READ_AGAIN", 0.05)
    monkeypatch.setattr(directory_module, "READ_EVERY", 0.05)
    real, failed = Store.read, 0

    async def read(store: Store, question: Callable[[Connection], object]) -> object:
        nonlocal failed
        if getattr(question, "__qualname__", "").startswith("Directory.") and failed < 5:
            failed += 1
            raise StoreFailed("disk I/O error")
        return await real(store, question)

    async with fleet.board("pi1"), fleet.agent("kid", "pi1") as kid:
        await kid.ask("join", stays=True)
    monkeypatch.setattr(Store, "read", read)
    async with fleet.board("pi1") as pi1, fleet.agent("twin", "pi1") as twin:
        assert identities(pi1.notes()) == [("directory_unread", "")]
        assert (await twin.ask("join")).problem == "", "nobody is served before it is read"
        assert pi1.notes() == ()
        assert failed == 5
        assert sorted(pi1.services.homes()) == ["a", "b", "c", "kid", "twin"]


async def test_what_another_board_says_is_taken_as_far_as_it_can_be_meant(fleet: Fleet) -> None:
    async with fleet.board("pi1") as pi1, fleet.agent("pi2", "pi1") as other:
        names = {"kid": ("cook", "", "x" * 1001), "*": (), "": (), "a>b": (), "a/b": ()}
        said = BoardServices(board="pi2", version=1, agents=names)
        key = keys.services(FLEET, "pi2")
        await subscribed(other.bus, key)
        other.bus.put(key, said)
        await until(lambda: pi1.services.homes().get("kid") == "pi2", "what it says is heard")
        assert sorted(pi1.services.homes()) == ["a", "b", "c", "kid"]
        assert pi1.services.others["pi2"].agents == {"kid": ("cook",)}


async def test_a_board_takes_no_more_than_other_boards_hear(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(directory_module, "MAX_RECORD_BYTES", 2_000)
    async with fleet.board("pi1") as pi1, fleet.agent("a", "pi1") as a:
        assert (await a.ask("register", "x" * 1_000)).problem == ""
        problem = (await a.ask("register", "y" * 1_000)).problem
        assert problem.endswith("bytes, the limit is 2000")
        assert pi1.services.providers("y" * 1_000) == ()
        assert (await a.ask("deregister", "x" * 1_000)).problem == ""
        assert (await a.ask("register", "y" * 1_000)).problem == ""


async def test_a_program_that_stays_keeps_its_name_while_away(fleet: Fleet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(directory_module, "FORGOTTEN_AFTER", 0.5)
    monkeypatch.setattr(directory_module, "LOOK_EVERY", 0.1)
    async with fleet.board("pi1") as pi1:
        async with join("planner", fleet=FLEET, board="pi1", router=fleet.endpoints["pi1"], stays=True):
            assert pi1.services.homes().get("planner") == "pi1"
        async with fleet.agent("kid", "pi1") as kid:
            await kid.ask("join")
        await until(lambda: pi1.services.homes().get("kid") is None, "who does not stay is forgotten")
        assert pi1.services.homes().get("planner") == "pi1"


async def test_the_other_boards_hear_who_has_left_though_the_disk_does_not_give_its_mail_up(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def unhost(mail_service: MailService, name: str) -> None:
        raise StoreFailed("the disk is full")

    async with fleet.board("pi1") as pi1, fleet.board("pi2") as pi2, fleet.agent("kid", "pi1") as kid:
        await kid.ask("join")
        await until(lambda: pi2.services.homes().get("kid") == "pi1", "pi2 knows kid")
        monkeypatch.setattr(MailService, "unhost", unhost)
        assert (await kid.ask("leave")).problem == ""
        assert pi1.services.homes().get("kid") is None
        await until(lambda: pi2.services.homes().get("kid") is None, "pi2 hears that kid has left")


async def test_mail_for_who_has_just_joined_another_board_is_not_refused_though_this_board_has_not_heard_of_it(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with (
        fleet.board("pi1") as pi1,
        fleet.board("pi2") as pi2,
        fleet.agent("a", "pi1") as a,
        fleet.agent("kid", "pi2") as kid,
    ):
        await until(lambda: {"pi1", "pi2"} <= set(pi1.services.others) | {"pi1"}, "pi1 has heard of pi2")
        monkeypatch.setattr(pi1, "_concerns_us", lambda _: False)  # what pi2 puts is lost
        await kid.ask("join")
        assert pi2.services.homes().get("kid") == "pi2"
        assert pi1.services.homes().get("kid") is None
        assert await post(a.bus, message(1, "a", "kid")) == Receipt(taken=1)
        assert await post(a.bus, message(1, "a", "nobody")) == Receipt(refused={0: Refusal(code="receiver_not_found")})
        await until(lambda: [one.content for one in kid.mail] == [1], "it arrives")
