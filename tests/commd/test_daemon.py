"""`commd serve` as a process."""

import asyncio
import math
import os
import signal
import socket
import threading
import time
from argparse import Namespace
from collections.abc import Awaitable, Callable
from contextlib import closing
from pathlib import Path
from typing import cast
from unittest.mock import Mock

import pytest
import zenoh

from commd.bus import session
from commd.bus.bus import Bus, open_bus
from commd.common.clock import Clock
from commd.daemon import serve
from commd.directory.service import Directory
from commd.process.process import Agents, _run, report_health
from schemas.mission.model import load_mission
from schemas.wire import keys
from schemas.wire.records import AgentHealth, BoardServices, Health, Note, Receipt, Record, ServiceRequest
from tests.commd.offices import ask, message
from tests.support.buses import FLEET, Connect, served, subscribed, until
from tests.support.processes import Daemon, running
from tests.support.promises import kept

MISSION = "missions/single_uav.yaml"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_commd_leaves_cleanly_within_a_second_when_told_to(endpoint: str, number: int) -> None:
    def leaving() -> float:
        with running("commd", "serve", MISSION, "--router", endpoint) as commd:
            commd.says("router board=local")
            started = time.monotonic()
            commd.signal(number)
            assert commd.ends() == 0
            return time.monotonic() - started

    assert kept(leaving, 1.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("commd serve MISSION", "router board=local"),
        ("argosy run MISSION --plain", "simulated copter"),
        ("argosy simulate MISSION", "simulated copter"),
        ("argosy ui --port 0", "open http"),
    ],
)
def test_a_terminal_that_goes_away_ends_nothing_under_nohup(endpoint: str, words: str, said: str) -> None:
    one = Daemon(*words.replace("MISSION", MISSION).split(), "--router", endpoint, within=["nohup"])
    try:
        one.says(said)
        status = dict(line.split(":", 1) for line in Path(f"/proc/{one.process.pid}/status").read_text().splitlines())
        assert int(status["SigIgn"], 16) >> signal.SIGHUP - 1 & 1
    finally:
        one.kill()


async def health_of(
    connect: Connect, details: Callable[[], Health], count: int = 1, agents: Agents | None = None
) -> list[Health]:
    """Return what an observer hears of a bridge that reports its health."""
    observer, bus = await connect("observer", "argosy"), await connect("uav1", "bridged")
    heard: list[Health] = []
    observer.subscribe(keys.health(FLEET, "uav1", "bridged"), Health, lambda _key, health: heard.append(health))
    await subscribed(bus, keys.health(FLEET, "uav1", "bridged"))
    reporting = asyncio.create_task(report_health(bus, "uav1", Clock(), details, lambda: agents or {}))
    await until(lambda: len(heard) >= count, "health goes on")
    reporting.cancel()
    return heard


async def test_a_figure_that_cannot_be_told_does_not_end_a_daemons_health(connect: Connect) -> None:
    details = Mock(side_effect=[KeyError("figure"), Health(notes=(Note("well", "all is well"),))])
    heard = await health_of(connect, details, 2)
    assert [note.identity for one in heard for note in one.notes] == [("defect", "health"), ("well", "")]


UNTELLABLE: dict[str, Health] = {
    "a name that is no Unicode": Health(counters={"\udcff": 1.0}),
    "no number": Health(counters={"x": math.nan}),
    "a word for a number": Health(counters={"x": cast(float, "much")}),
}


@pytest.mark.parametrize("what", UNTELLABLE)
async def test_a_daemon_whose_health_others_cannot_read_still_says_that_it_lives(connect: Connect, what: str) -> None:
    heard = await health_of(connect, lambda: UNTELLABLE[what])
    assert heard[0].pid == os.getpid()
    assert [note.code for note in heard[0].notes] == ["health_unsendable"]


async def test_a_figure_of_one_agent_that_cannot_be_made_or_told_hides_no_other_agent(connect: Connect) -> None:
    agents: Agents = {"a": Mock(side_effect=KeyError("figure")), "b": lambda: AgentHealth(idle=True)}
    (told,) = await health_of(connect, Health, agents=agents)
    assert [note.identity for note in told.agents["a"].notes] == [("defect", "health")]
    assert told.agents["b"] == AgentHealth(idle=True)
    agents = {"a": lambda: AgentHealth(counters={"x": math.nan}, idle=False), "b": lambda: AgentHealth(idle=True)}
    (told,) = await health_of(connect, Health, agents=agents)
    assert [note.code for note in told.notes] == ["health_unsendable"]
    assert told.agents == {"a": AgentHealth(idle=False), "b": AgentHealth(idle=True)}


async def test_the_health_of_many_agents_is_bounded_the_rest_counted_and_each_agent_is_there(connect: Connect) -> None:
    figures = {f"c{number}": 1.0 for number in range(100)}
    agents: Agents = {f"a{n}": lambda: AgentHealth(counters=figures, idle=True) for n in range(300)}
    (told,) = await health_of(connect, Health, agents=agents)
    assert all(its.idle for its in told.agents.values())
    assert [len(its.counters) for its in told.agents.values()] == [100] * 200 + [0] * 100
    assert told.left_out == 100 * 100


async def test_health_goes_before_what_fills_a_slow_link(connect: Connect) -> None:
    observer, bus = await connect("observer", "argosy"), await connect("uav1", "bridged")
    came: list[tuple[str, zenoh.Priority]] = []
    observer._session.declare_subscriber(
        f"argosy/{FLEET}/**", lambda sample: came.append((str(sample.key_expr), sample.priority))
    )
    health, other = keys.health(FLEET, "uav1", "bridged"), f"argosy/{FLEET}/uav1/manifest"
    await subscribed(bus, health)
    bus.put(other, Health())
    reporting = asyncio.create_task(report_health(bus, "uav1", Clock()))
    await until(lambda: len({key for key, _ in came}) == 2, "both come")
    reporting.cancel()
    assert dict(came) == {other: zenoh.Priority.DATA, health: zenoh.Priority.INTERACTIVE_HIGH}


async def test_warnings_of_health_are_lines_of_unicode_and_bounded(connect: Connect) -> None:
    texts = ("no file \udcff.jpg", *("x" * 10_000 for _ in range(1000)))
    heard = await health_of(connect, lambda: Health(notes=tuple(Note("x", text, text) for text in texts)))
    assert heard[0].notes[0] == Note("x", r"no file \udcff.jpg", r"no file \udcff.jpg")
    assert sum(len(note.text) + len(note.about) for note in heard[0].notes) < 800_000


def test_two_routers_on_one_endpoint_do_not_start_and_the_second_says_why(endpoint: str) -> None:
    with running("commd", "serve", MISSION, "--router", endpoint) as first:
        first.says("router board=local")
        with running("commd", "serve", MISSION, "--router", endpoint) as second:
            assert second.ends() == 1
            assert f"error: commd: cannot listen at {endpoint}" in second.text
            assert "Traceback" not in second.text


def test_a_router_that_hangs_keeps_nobody_from_leaving(endpoint: str) -> None:
    async def body() -> float:
        with running("commd", "serve", MISSION, "--router", endpoint) as commd:
            await asyncio.to_thread(commd.says, "router board=local")
            async with open_bus(endpoint, fleet=FLEET, name="uav", daemon="agentd") as bus:
                await bus.claim("uav")
                commd.signal(signal.SIGSTOP)
                await until(lambda: not bus.router_up, "the router is missed")
                started = time.monotonic()
            return time.monotonic() - started

    assert kept(lambda: asyncio.run(asyncio.wait_for(body(), 240)), 3.0)


async def test_a_session_that_zenoh_does_not_close_is_left_behind_and_the_log_says_so(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    returned = threading.Event()

    def close(opened: zenoh.Session) -> None:
        returned.wait(60)
        opened.close()

    async with open_bus(endpoint, fleet=FLEET, name="b", daemon="commd", mode="router"):
        monkeypatch.setattr(session, "_close", close)
        monkeypatch.setattr(session, "CLOSE_PATIENCE", 0.1)
    returned.set()
    assert "the router hangs: this session ends without notice to it" in caplog.text


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "mission: x\nagents:\n  uav: {progam: a.asl}\n",
            [
                "PATH:3:3: error: agents.uav: needs the field `program`",
                "PATH:3:9: error: agents.uav.progam: there is no such field, did you mean `program`?",
            ],
        ),
        (
            "mission: m\nboards: {one: {}, two: {}}\nagents: {a: {program: a.asl, board: one}}\n",
            ["PATH: error: which board is this? Name it by --board: the mission has one, two"],
        ),
    ],
    ids=["a bad mission", "which of several boards it is"],
)
def test_what_commd_cannot_serve_is_findings(tmp_path: Path, endpoint: str, text: str, said: list[str]) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with running("commd", "serve", str(path), "--router", endpoint) as commd:
        assert commd.ends() == 2
        assert commd.lines == [line.replace("PATH", str(path)) for line in said]


def test_the_gateways_board_alone_listens_to_nodes(tmp_path: Path, endpoint: str, free_port: Callable[[], int]) -> None:
    address = ("127.0.0.1", free_port())
    gateway = f'gateway: {{board: b, listen: "127.0.0.1:{address[1]}", nodes: {{old: "127.0.0.1:9"}}}}'
    agents = "agents: {u: {program: u.asl, board: a}}"
    (tmp_path / "m.yaml").write_text(f"mission: m\nboards: {{a: {{}}, b: {{}}}}\n{agents}\n{gateway}\n")
    for board, listens in (("a", False), ("b", True)):
        state = ("--state", str(tmp_path / board))
        file = str(tmp_path / "m.yaml")
        with running("commd", "serve", file, "--board", board, "--router", endpoint, *state) as commd:
            commd.says(f"router board={board}")
            assert _is_bound(address) == listens


def _is_bound(address: tuple[str, int]) -> bool:
    with closing(socket.socket(type=socket.SOCK_DGRAM)) as probe:
        try:
            probe.bind(address)
        except OSError:
            return True
    return False


@pytest.mark.parametrize("endpoint", ["carrier-pigeon/here", "tcp/127.0.0.1:99999", "127.0.0.1:7447", ""])
def test_what_is_no_endpoint_is_refused_with_what_is_one(endpoint: str) -> None:
    with running("commd", "serve", MISSION, "--router", endpoint) as commd:
        assert commd.ends() == 2
        assert commd.lines[-1].endswith(f"Expected an endpoint such as `tcp/127.0.0.1:7447`, got `{endpoint}`")


class Panic(BaseException):
    """What a panic of Zenoh's is in Python."""


def put_in_vain(bus: Bus, key: str, record: Record, **more: bool) -> None:
    if "/health/" in key:
        raise Panic("called `Result::unwrap()` on an `Err` value: PoisonError")


async def fail(_: Directory) -> None:
    raise RuntimeError("a defect")


def arguments(endpoint: str, state: Path) -> Namespace:
    return Namespace(board=None, router=endpoint, keys=None, listen=[], connect=[], state=state, config=None)


@pytest.mark.parametrize(
    ("owner", "name", "broken", "part"),
    [
        (Bus, "put", put_in_vain, "the router"),
        (Directory, "_follow", fail, "the directory"),
        (Directory, "_forget_who_is_gone", fail, "the directory"),
    ],
)
async def test_a_part_that_breaks_ends_commd_so_that_it_is_started_again(
    owner: type[Bus | Directory],
    name: str,
    broken: object,
    part: str,
    endpoint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(owner, name, broken)
    assert await serve(load_mission(MISSION), arguments(endpoint, tmp_path), asyncio.Event()) == 1
    assert f"{part} is broken" in caplog.text


async def test_mail_for_who_joined_in_a_former_life_is_not_refused_while_commd_starts(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    args, mission = arguments(endpoint, tmp_path), load_mission(MISSION)
    real, asked = Directory.load, asyncio.Event()

    async def late(directory: Directory) -> bool:
        await asked.wait()  # a big file on a slow disk
        return await real(directory)

    async def life(body: Callable[[Bus], Awaitable[None]]) -> None:
        stop = asyncio.Event()
        commd = asyncio.create_task(serve(mission, args, stop))
        try:
            async with (
                asyncio.timeout(240),
                open_bus(endpoint, fleet=mission.fleet, name="uav", daemon="agentd") as bus,
            ):
                await body(bus)
        finally:
            stop.set()
            assert await asyncio.wait_for(commd, 120) == 0

    async def first(bus: Bus) -> None:
        key = keys.services(mission.fleet, "local")
        await served(bus, key)
        request = ServiceRequest(agent="kid", do="join", stays=True)
        assert (await bus.ask_one(key, request, BoardServices, 10)).problem == ""

    async def second(bus: Bus) -> None:
        key = keys.outbox(mission.fleet, "uav")
        await served(bus, key)
        answers = [await ask(bus, key, message(1, "uav", "kid"))]
        while not isinstance(answers[-1], Receipt):
            asked.set()
            answers.append(await ask(bus, key, message(1, "uav", "kid")))
        assert answers[-1] == Receipt(taken=1)
        assert set(answers[:-1]) == {"board local is still reading who joined it"}

    await life(first)
    monkeypatch.setattr(Directory, "load", late)
    await life(second)


def test_a_panic_of_the_router_anywhere_ends_a_daemon_with_words(capfd: pytest.CaptureFixture[str]) -> None:
    async def main(stop: asyncio.Event) -> int:
        raise Panic("called `Option::unwrap()` on a `None` value")

    assert _run("commd", main) == 1
    told = capfd.readouterr().err
    assert "error: commd: defect in argosy: Panic: called `Option::unwrap()` on a `None` value" in told
    assert "Traceback" not in told
