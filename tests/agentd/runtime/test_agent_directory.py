"""The directory as a daemon's agents use it: names, beliefs about who is online (real minds and routers), services."""

import asyncio
from argparse import Namespace
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, cast

import pytest

from agentd.mind.data.inputs import SignalRaised
from agentd.runtime.agent_directory import (
    AT_ONCE,
    PATIENCE,
    UNREPORTED,
    UNREPORTED_AWAY,
    AgentDirectory,
    NotDone,
    Services,
)
from agentd.runtime.agent_group import AgentGroup
from agentd.runtime.program_loader import prepare
from commd.bus.bus import Bus, Query
from commd.bus.errors import QueryTimeout
from commd.common.clock import Clock
from commd.daemon import serve as serve_commd
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import BoardServices, ServiceRequest
from tests.support.buses import FLEET, Connect, ended, served, session, until, virtual_test

MISSION = """\
mission: test
fleet: test
boards:
  pi1: {}
  pi2: {}
agents:
  a: {program: a.asl, board: pi1, presence: true}
  b: {program: b.asl, board: pi2, presence: true}
  quiet: {program: quiet.asl, board: pi1}
clients:
  console: {board: pi1}
"""


class Boards:
    """Two boards in one process: pi1 listens, pi2 dials."""

    def __init__(self, folder: Path, port: Callable[[], int]) -> None:
        self.folder = folder
        (folder / "m.yaml").write_text(MISSION)
        for name in ("a", "b", "quiet"):
            program = "+online(X)[board(B)] <- +came(X, B). -online(X)[board(B)] <- +went(X, B).\n"
            (folder / f"{name}.asl").write_text(program)
        self.mission: Mission = load_mission(folder / "m.yaml")
        self.link = f"tcp/127.0.0.1:{port()}"
        self.endpoints = {board: f"tcp/127.0.0.1:{port()}" for board in ("pi1", "pi2")}

    @asynccontextmanager
    async def commd(self, board: str) -> AsyncIterator[None]:
        """The comm daemon of a board, in this process."""
        listen, connect = ([self.link], []) if board == "pi1" else ([], [self.link])
        args = Namespace(
            board=board,
            router=self.endpoints[board],
            keys=None,
            listen=listen,
            connect=connect,
            state=self.folder / "state",
            config=None,
        )
        stop = asyncio.Event()
        task = asyncio.create_task(serve_commd(self.mission, args, stop))
        try:
            yield
        finally:
            stop.set()
            await ended(task, f"commd of {board}")

    @asynccontextmanager
    async def agents(self, board: str, *names: str) -> AsyncIterator[AgentGroup]:
        """A daemon of agents, in this process."""
        async with session(self.endpoints[board], names[0]) as bus:
            agent_group = AgentGroup(bus, Clock(), self.mission, self.folder / "agents", 0)
            await agent_group.add(*(prepare(self.mission, name, 0) for name in names))
            stop = asyncio.Event()
            task = asyncio.create_task(agent_group.run(stop))
            try:
                yield agent_group
            finally:
                stop.set()
                await ended(task, f"agentd of {board}")


@pytest.fixture
def boards(tmp_path: Path, free_port: Callable[[], int]) -> Boards:
    return Boards(tmp_path, free_port)


def beliefs(agent_group: AgentGroup, agent: str) -> list[str]:
    """What an agent believes of who is there, and has noted of it."""
    return [one.text for one in agent_group.hosts[agent].viewer.view().beliefs if not one.text.startswith("kqml")]


async def believes(agent_group: AgentGroup, agent: str, *expected: str) -> None:
    await until(lambda: set(beliefs(agent_group, agent)) >= set(expected), f"{agent} believes {expected}")


HERE, CAME = "online(b)[board(pi2),source(percept)]", "came(b,pi2)[source(self)]"


async def test_an_agent_believes_who_is_there_and_where_and_learns_who_comes_and_goes(boards: Boards) -> None:
    async with boards.commd("pi1"), boards.commd("pi2"), boards.agents("pi1", "a", "quiet") as first:
        await believes(first, "a", "online(quiet)[board(pi1),source(percept)]", "came(quiet,pi1)[source(self)]")
        async with boards.agents("pi2", "b") as second:
            await believes(first, "a", HERE, CAME)
            await believes(second, "b", "online(a)[board(pi1),source(percept)]", "came(a,pi1)[source(self)]")
        await believes(first, "a", "went(b,pi2)[source(self)]")
        assert HERE not in beliefs(first, "a")
        assert beliefs(first, "quiet") == [], "it has not asked for it"


async def test_a_client_is_company_as_well_and_who_is_nobodys_agent_is_not(boards: Boards) -> None:
    async with (
        boards.commd("pi1"),
        boards.agents("pi1", "a") as agent_group,
        session(boards.endpoints["pi1"], "stranger") as stranger,
        session(boards.endpoints["pi1"], "console", "client") as console,
    ):
        await stranger.claim("stranger")
        await console.claim("console")
        await believes(agent_group, "a", "online(console)[board(pi1),source(percept)]")
        assert not any("stranger" in belief for belief in beliefs(agent_group, "a"))


async def test_an_agent_made_at_run_time_is_online_on_the_other_board_until_it_ends(boards: Boards) -> None:
    (boards.folder / "b.asl").write_text("+go <- .create_agent(kid). +stop <- .kill_agent(kid).\n")

    async with (
        boards.commd("pi1"),
        boards.commd("pi2"),
        boards.agents("pi1", "a") as first,
        boards.agents("pi2", "b") as second,
    ):
        await believes(first, "a", HERE)
        second.hosts["b"].feed(SignalRaised.named("go"))
        await believes(first, "a", "online(kid)[board(pi2),source(percept)]")
        assert "kid" in first.directory.names
        await until(lambda: "kid" in second.hosts, "kid has begun")
        second.hosts["b"].feed(SignalRaised.named("stop"))
        await believes(first, "a", "went(kid,pi2)[source(self)]")
        await until(lambda: "kid" not in first.directory.names, "kid is forgotten")


@pytest.mark.parametrize("board", ["pi1", "pi2"])
async def test_a_router_that_restarts_takes_no_agent_with_it(boards: Boards, board: str) -> None:
    """Ours (pi1), and that of the other board (pi2)."""
    other = {"pi1": "pi2", "pi2": "pi1"}[board]

    async with AsyncExitStack() as agents, boards.commd(other):
        async with boards.commd(board):
            first = await agents.enter_async_context(boards.agents("pi1", "a"))
            second = await agents.enter_async_context(boards.agents("pi2", "b"))
            await believes(first, "a", HERE, CAME)
        async with boards.commd(board), session(boards.endpoints["pi1"], "observer") as observer:
            await until(lambda: observer.tokens(keys.alive("test", "b", "agentd", "*")), "b is there")
            await until(lambda: first._presence_beliefs._presence.complete, "nobody is missed any more")
            assert HERE in beliefs(first, "a")
            assert not any(belief.startswith("went") for belief in beliefs(first, "a"))
            second.hosts["b"].close()
            await believes(first, "a", "went(b,pi2)[source(self)]")


async def test_without_a_router_for_long_only_those_of_the_same_daemon_are_there(
    boards: Boards, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.liveness.presence.BUS_GRACE", 1.0)

    async with AsyncExitStack() as agents, boards.commd("pi2"):
        async with boards.commd("pi1"):
            first = await agents.enter_async_context(boards.agents("pi1", "a", "quiet"))
            await agents.enter_async_context(boards.agents("pi2", "b"))
            await believes(first, "a", HERE)
        await believes(first, "a", "went(b,pi2)[source(self)]")
        assert "online(quiet)[board(pi1),source(percept)]" in beliefs(first, "a")
        async with boards.commd("pi1"):
            await believes(first, "a", HERE)


async def test_who_had_mail_in_a_former_life_is_known_until_the_directory_answers(connect: Connect) -> None:
    bus = await connect("a")
    agents = AgentDirectory(bus, {"a": "pi1"})
    agents.remember({"planner", "gone", "mail", "df", "a"})
    assert sorted(agents.names) == ["a", "gone", "planner"]
    directory = await connect("pi1", "commd")

    async def serve(query: Query[BoardServices]) -> None:
        header, agents = directory.header("services", "pi1"), {"planner": ()}
        said = BoardServices(header=header, board="pi1", version=1, agents=agents)
        query.reply(said, keys.services(FLEET, "pi1"))

    directory.serve(keys.services(FLEET, "pi1"), BoardServices, serve)
    await served(bus, keys.services(FLEET, "pi1"))
    await agents.watch(["pi1"])
    assert agents.names == {"a": "pi1", "planner": "pi1"}


async def test_a_board_publishes_only_its_own_agents(connect: Connect) -> None:
    agents, pi1, pi3 = AgentDirectory(await connect("a"), {"a": "pi1"}), await connect("pi1"), await connect("pi3")

    async def serve(query: Query[BoardServices]) -> None:
        query.reply(services(pi1, "pi1", "pi1_kid"), keys.services(FLEET, "pi1"))

    pi1.serve(keys.services(FLEET, "pi1"), BoardServices, serve)
    await served(pi1, keys.services(FLEET, "pi1"))
    await agents.watch(["pi1"])
    pi3.put(keys.services(FLEET, "pi3"), services(pi3, "pi1", "pi1_other"))
    pi3.put(keys.services(FLEET, "pi3"), services(pi3, "pi3", "pi3_kid", "pi1_more", "a/b", "mine"))
    await until(lambda: "pi3_kid" in agents.names, "what it may publish is known")
    assert agents.names == {"a": "pi1", "pi1_kid": "pi1", "pi3_kid": "pi3"}


def services(bus: Bus, board: str, *agents: str) -> BoardServices:
    """The record of a board of a fleet whose access is controlled."""
    offers: dict[str, tuple[str, ...]] = dict.fromkeys(agents, ())
    return BoardServices(header=bus.header("services"), board=board, version=9, prefix=f"{board}_", agents=offers)


class Answers:
    """The bus to the directories of pi1 and pi2, which know `late` from the third query; those in `away` are silent."""

    fleet = "test"

    def __init__(self, away: Collection[str]) -> None:
        self.away = away
        self.asked = 0

    async def ask_all(self, key: str, kind: Any, seconds: float, take: Callable[[str, BoardServices], None]) -> None:
        self.asked += 1
        board, agents = key.split("/")[-2], {"late": ()} if self.asked > 2 else {}
        if board not in self.away:
            take(key, BoardServices(board=board, version=self.asked, agents=agents))


@pytest.mark.parametrize(("away", "ended_after"), [((), UNREPORTED), (("pi2",), UNREPORTED_AWAY)])
async def test_a_sender_is_forgotten_that_no_board_reports_for_long_however_often_they_are_asked(
    away: Collection[str], ended_after: float
) -> None:
    wall, bus = 0.0, Answers(away)
    agents = AgentDirectory(cast(Bus, bus), {"a": "pi1"}, lambda: wall)
    follow = asyncio.create_task(agents.follow(["pi1", "pi2"]))

    async def asked_for(name: str) -> None:
        before = bus.asked
        agents.met(name)
        await until(lambda: bus.asked == before + 2, f"both boards are asked for {name}")

    for name in ("killed", "late", "busy", "kept"):
        await asked_for(name)
    assert agents.names == {"a": "pi1", "killed": "", "late": "pi1", "busy": "", "kept": ""}
    wall = ended_after
    agents.met("busy")
    await asked_for("one")
    assert "killed" in agents.names
    wall, bus.away = ended_after + 1, ("pi1", "pi2")
    await asked_for("two")
    assert "killed" in agents.names, "nobody has answered"
    bus.away = away
    await asked_for("three")
    assert agents.names == {"a": "pi1", "late": "pi1", "busy": "", "one": "", "two": "", "three": ""}
    follow.cancel()


# --- services ---


class Directories:
    """The bus, and on it the directory of the board `here`, which takes a time for each answer; others are silent."""

    fleet = "test"

    def __init__(self, takes: float = 0.0) -> None:
        self._takes = takes
        self.asked = 0

    async def ask_one(self, key: str, request: ServiceRequest, kind: Any, seconds: float) -> BoardServices:
        self.asked += 1
        if "/here/" in key:
            await asyncio.sleep(self._takes)
            return BoardServices(board="here")
        await asyncio.sleep(seconds)
        raise QueryTimeout(key, seconds)


@pytest.mark.parametrize("agents", [1, 200])
@virtual_test
async def test_a_directory_that_does_not_answer_is_given_up_by_all_at_the_same_time(agents: int) -> None:
    services = Services(cast(Bus, Directories()))
    asked = [services.ask("gone", f"a{n % agents}", "search", "s") for n in range(200)]
    failed = await asyncio.gather(*asked, return_exceptions=True)
    assert all(isinstance(one, NotDone) and not one.answered for one in failed)
    assert "the directory of board gone does not answer: " in str(failed[0])
    assert "those before it have had no answer either" in str(failed[-1])
    assert asyncio.get_running_loop().time() < 3 * PATIENCE, "not one after the other"


@virtual_test
async def test_those_who_ask_a_silent_board_hold_up_nobody_who_asks_another() -> None:
    services = Services(cast(Bus, Directories()))
    in_vain = [asyncio.create_task(services.ask("gone", f"a{n}", "search")) for n in range(2 * AT_ONCE)]
    await asyncio.sleep(0)
    assert (await services.ask("here", "b", "search")).board == "here"
    assert not any(task.done() for task in in_vain)
    for task in in_vain:
        task.cancel()
    await asyncio.gather(*in_vain, return_exceptions=True)


@virtual_test
async def test_a_crowd_is_answered_in_turn_however_long_that_takes_in_all() -> None:
    directories = Directories(takes=PATIENCE / 4)
    services = Services(cast(Bus, directories))
    answers = await asyncio.gather(*(services.ask("here", f"a{n}", "join") for n in range(6 * AT_ONCE)))
    assert len(answers) == directories.asked == 6 * AT_ONCE
    assert asyncio.get_running_loop().time() > PATIENCE
