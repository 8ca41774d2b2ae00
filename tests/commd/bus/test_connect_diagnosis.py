"""Who is let in by mutual TLS and who is not, by real routers; and why, in words where Zenoh has none."""

import asyncio
import json
import os
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any, cast

import pytest
import zenoh

from commd.bus import connect_diagnosis
from commd.bus.bus import Bus, open_bus
from commd.bus.connect_diagnosis import attempt, why_not
from commd.bus.errors import BusClosed
from commd.bus.session import session_config
from commd.bus.tls import Tls
from commd.router.link_monitor import Links, dates
from schemas.mission.model import read_mission
from tests.support.buses import until
from tests.support.fleet_keys import FleetKeys
from tests.support.notes import identities

Port = Callable[[], int]
TWO = 'mission: m\nboards: {pi1: {address: "ONE"}, pi2: {address: "TWO"}}\nagents: {a: {program: a.asl, board: pi1}}\n'


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> FleetKeys:
    return FleetKeys(tmp_path_factory.mktemp("keys"))


@asynccontextmanager
async def router(free_port: Port, tls: Tls, *, at: str = "", dials: str = "", name: str = "pi1") -> AsyncIterator[Bus]:
    async with open_bus(
        f"tcp/127.0.0.1:{free_port()}",
        fleet="test",
        name=name,
        daemon="commd",
        mode="router",
        listen=[at] if at else [],
        connect=[dials] if dials else [],
        tls=tls,
    ) as bus:
        yield bus


def comes_in(at: str, tls: Tls | None, raw: dict[str, Any] | None = None) -> bool:
    """Whether Zenoh opens a session there."""
    config = session_config("client", at, "test", tls=tls)
    if raw is not None:
        config.insert_json5("transport/link/tls", json.dumps(raw))
    try:
        with zenoh.open(config):
            return True
    except zenoh.ZError:
        return False


Make = Callable[[FleetKeys, Path], Tls | None]
REFUSED: dict[str, tuple[Make, str]] = {
    "of another authority, with the same names": (
        lambda fleet, folder: FleetKeys(folder).make("pi2"),
        "who is there has a certificate that our ca.pem does not believe",
    ),
    "of another authority, who believes ours": (
        lambda fleet, folder: replace(FleetKeys(folder).make("pi2"), root=fleet.make("pi2").root),
        "our own keys: ",
    ),
    "revoked, that is of a generation which nobody believes": (
        lambda fleet, _: fleet.make("pi2", ("pi1", fleet.machine("pi2", generation=7)), generation=7),
        "it does not believe the certificate of `pi2`: another fleet's, or a revoked one",
    ),
    "expired": (lambda fleet, _: fleet.make("pi2", ends=-5), "the certificate of `pi2` expired on"),
    "not yet valid": (lambda fleet, _: fleet.make("pi2", begins=3600, ends=7200), "is valid from"),
    "no keys": (lambda *_: None, "it is reached with keys alone: say where they are by --keys FOLDER"),
}


@pytest.mark.parametrize("keys", REFUSED)
async def test_who_has_no_good_keys_does_not_come_in_and_is_told_why(
    fleet: FleetKeys, tmp_path: Path, free_port: Port, keys: str
) -> None:
    make, words = REFUSED[keys]
    at = f"tls/127.0.0.1:{free_port()}"
    async with router(free_port, fleet.make("pi1"), at=at):
        tls = make(fleet, tmp_path)
        assert not await asyncio.to_thread(comes_in, at, tls)
        assert words in await why_not(at, tls)
        with pytest.raises(BusClosed, match=r"no router at tls/.*: ") as error:
            async with open_bus(at, fleet="test", name="x", daemon="x", tls=tls, patience=0):
                raise AssertionError("came in")
        assert words in str(error.value)
        good = fleet.make("pi2")
        assert await asyncio.to_thread(comes_in, at, good), "who has good keys comes in"
        assert await why_not(at, good) == ""


async def test_who_shows_no_certificate_or_speaks_no_tls_does_not_come_in(fleet: FleetKeys, free_port: Port) -> None:
    at = f"tls/127.0.0.1:{free_port()}"
    tls = fleet.make("pi1")
    async with router(free_port, tls, at=at):
        assert not await asyncio.to_thread(comes_in, at, None, {"root_ca_certificate": str(tls.root)})
        plain = at.replace("tls/", "tcp/")
        assert not await asyncio.to_thread(comes_in, plain, None)
        assert await why_not(plain, None) == "it speaks TLS: say `tls/...`, and --keys FOLDER"


async def test_what_answers_as_no_router_does_is_named(free_port: Port) -> None:
    async def answers(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if await reader.read(64) == connect_diagnosis.EMPTY_FRAME:
            writer.write(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        writer.close()

    server = await asyncio.start_server(answers, "127.0.0.1", port := free_port())
    async with server:
        assert await why_not(f"tcp/127.0.0.1:{port}", None) == "what listens there is no Zenoh router"
    at = f"tcp/127.0.0.1:{free_port()}"
    async with open_bus(at, fleet="test", name="pi1", daemon="commd", mode="router"):
        with socket.create_connection(("127.0.0.1", int(at.rpartition(":")[2])), 2) as connection:
            connection.settimeout(60)
            connection.sendall(connect_diagnosis.EMPTY_FRAME)
            answer = await asyncio.to_thread(connection.recv, 64)
        assert answer[connect_diagnosis.LENGTH] & connect_diagnosis.MESSAGE_ID == connect_diagnosis.CLOSE
        assert await why_not(at, None) == ""


SERVERS: dict[str, tuple[Make, str]] = {
    "of another authority": (
        lambda _, folder: FleetKeys(folder).make("pi1"),
        "who is there has a certificate that our ca.pem does not believe",
    ),
    "of a board elsewhere": (
        lambda fleet, _: fleet.make("pi2", hosts=("10.0.0.12",)),
        "who is there is `pi2`, with a certificate for 10.0.0.12 and not for 127.0.0.1",
    ),
    "expired": (lambda fleet, _: fleet.make("pi1", ends=-5), "its certificate, `pi1`, expired on 20"),
    "not yet valid": (lambda fleet, _: fleet.make("pi1", begins=3600, ends=7200), "and the clock here says 20"),
}


@pytest.mark.parametrize("keys", SERVERS)
async def test_nobody_goes_to_a_board_whose_certificate_is_not_good(
    fleet: FleetKeys, tmp_path: Path, free_port: Port, keys: str
) -> None:
    make, words = SERVERS[keys]
    at = f"tls/127.0.0.1:{free_port()}"
    shown = make(fleet, tmp_path)
    assert shown is not None
    async with router(free_port, shown, at=at):
        ours = fleet.make("pi3")
        assert not await asyncio.to_thread(comes_in, at, ours)
        assert words in await why_not(at, ours)


def test_what_else_keeps_a_router_out_of_reach_is_told(fleet: FleetKeys, tmp_path: Path, free_port: Port) -> None:
    tls = fleet.make("pi2")
    nobody = f"127.0.0.1:{free_port()}"
    assert attempt(f"tls/{nobody}", tls) == "is commd running? Nobody listens there"
    assert attempt(f"tcp/{nobody}", None) == "is commd running? Nobody listens there"
    assert attempt(f"unixsock-stream/{tmp_path}/none", None) == "is commd running? There is no such socket"
    with socket.create_server(("127.0.0.1", 0)) as mute:
        at = f"tls/127.0.0.1:{mute.getsockname()[1]}"
        silent = "it connects and says nothing within 2 s: overloaded, hung, or a router without keys"
        assert attempt(at, tls) == silent
    assert attempt("tls/nowhere.invalid:7447", tls).startswith("there is no host `nowhere.invalid`")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
def test_a_stranger_is_told_for_whom_a_boards_socket_is() -> None:
    path = f"/tmp/argosy-{os.getpid()}.sock"
    code = (
        "import os, sys; from commd.bus.connect_diagnosis import attempt\n"
        "os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        "print(attempt(f'unixsock-stream/{sys.argv[1]}', None))"
    )
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen(1)
        os.chmod(path, 0o770)
        try:
            said = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, timeout=60)
        finally:
            os.unlink(path)
    assert said.stdout.startswith("this user may not use the socket: it is for the members of its group"), said.stderr


async def test_a_board_tells_which_link_is_missing_and_why_until_it_is_there(fleet: FleetKeys, free_port: Port) -> None:
    one, two = (f"127.0.0.1:{free_port()}" for _ in range(2))
    mission = read_mission(TWO.replace("ONE", one).replace("TWO", two), Path("m.yaml"))
    old = fleet.make("pi2", ends=-5)
    tls = fleet.make("pi1", ends=90 * 86_400)
    async with router(free_port, tls, at=f"tls/{one}") as bus:
        links = Links(bus, mission, "pi1", tls, look=0.05)
        watching = asyncio.create_task(links.watch())
        await until(lambda: bool(links.health().notes), "the link is missed")
        assert identities(links.health().notes) == [("link_missing", "pi2")]
        async with router(free_port, old, at=f"tls/{two}", name="pi2"):
            expired = "no link to pi2: its certificate, `pi2`, expired on"
            await until(lambda: links.health().notes[0].text.startswith(expired), "the certificate is called expired")
        async with router(free_port, fleet.make("pi2"), at=f"tls/{two}", dials=f"tls/{one}", name="pi2"):
            await until(lambda: not links.health().notes, "the link is there")
            assert bus.linked() == {"pi2"}
        watching.cancel()


@pytest.mark.parametrize(
    ("days", "words"), [(31, ""), (29, "the certificate of pi2 ends on"), (-1, "the certificate of `pi2` expired on")]
)
def test_a_board_tells_when_its_own_certificate_ends_soon(fleet: FleetKeys, days: int, words: str) -> None:
    said, over = dates(fleet.make("pi2", ends=days * 86_400), time.time())
    assert said.startswith(words)
    assert bool(said) == bool(words)
    assert over == (days < 0)


class FewLinks:
    """A router's session with so many links, or one that cannot say."""

    def __init__(self) -> None:
        self.those: Counter[str] | None = Counter()

    def links(self) -> Counter[str]:
        if self.those is None:
            raise OSError("no session")
        return self.those


async def test_a_board_tells_that_its_router_has_little_room_left_and_who_takes_it(fleet: FleetKeys) -> None:
    bus = FewLinks()
    mission = read_mission(TWO.replace("ONE", "").replace("TWO", ""), Path("m.yaml"))
    links = Links(cast(Bus, bus), mission, "pi1", fleet.make("pi1", ends=90 * 86_400), look=0.01, most=10)
    watching = asyncio.create_task(links.watch())
    bus.those = Counter({"": 2, "eye": 6})
    await until(lambda: identities(links.health().notes) == [("links_full", "")], "it is told")
    assert links.health().notes[0].value == 8
    assert "`eye` has 6 of them" in links.health().notes[0].text
    assert links.health().counters["links"] == 8
    bus.those = Counter({"": 2, "eye": 5})
    await until(lambda: links.health().notes == (), "there is room")
    watching.cancel()


async def test_a_failed_watch_of_links_says_so_and_goes_on(fleet: FleetKeys, caplog: pytest.LogCaptureFixture) -> None:
    bus = FewLinks()
    mission = read_mission(TWO.replace("ONE", "").replace("TWO", ""), Path("m.yaml"))
    links = Links(cast(Bus, bus), mission, "pi1", fleet.make("pi1", ends=90 * 86_400), look=0.01)
    watching = asyncio.create_task(links.watch())
    bus.those = None
    await until(lambda: identities(links.health().notes) == [("defect", "links")], "it is told")
    bus.those = Counter({"": 1})
    await until(lambda: links.health().notes == (), "it goes on")
    watching.cancel()
    assert caplog.text.count("defect in argosy: the watch over the links") < 3, "not at each look"


def test_a_name_service_that_does_not_answer_keeps_one_thread_for_each_endpoint_and_none_that_others_need(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answered, begun = Event(), list[str]()

    def attempt(endpoint: str, tls: Tls | None) -> str:
        begun.append(endpoint)
        answered.wait(60)
        return f"no {endpoint}"

    monkeypatch.setattr(connect_diagnosis, "attempt", attempt)
    monkeypatch.setattr(connect_diagnosis, "PATIENCE", 0.05)

    async def body() -> None:
        ends = [f"tls/pi{number}.local:7447" for number in range(20)]
        for _ in range(3):
            assert set(await asyncio.gather(*(why_not(end, None) for end in ends))) == {
                "the name service does not answer"
            }
        assert sorted(begun) == sorted(ends), "none is asked again while it is being asked"
        assert await asyncio.wait_for(asyncio.to_thread(lambda: "free"), 120) == "free"
        monkeypatch.setattr(connect_diagnosis, "PATIENCE", 10)
        waiting = asyncio.create_task(why_not(ends[0], None))
        await asyncio.sleep(0)
        answered.set()
        assert await waiting == f"no {ends[0]}"

    try:
        asyncio.run(asyncio.wait_for(body(), 240))
    finally:
        answered.set()


async def test_an_expired_certificate_ends_its_links_and_a_new_one_on_disk_is_dialled_with_at_once(
    fleet: FleetKeys, free_port: Port
) -> None:
    at = f"tls/127.0.0.1:{free_port()}"
    tls = fleet.make("pi2", ends=6)
    async with router(free_port, fleet.make("pi1"), at=at) as one, router(free_port, tls, dials=at, name="pi2"):
        await until(lambda: one.linked() == {"pi2"}, "pi2 is linked")
        await until(lambda: not one.linked(), "the link ends with the certificate")
        fleet.write(tls.key.parent, "pi2")
        await until(lambda: one.linked() == {"pi2"}, "pi2 is linked again, and was not started again")


async def test_a_certificate_that_is_not_valid_yet_is_good_in_its_time(fleet: FleetKeys, free_port: Port) -> None:
    """As when a clock is set late: neither side is started again."""
    at, its = (f"tls/127.0.0.1:{free_port()}" for _ in range(2))
    early = fleet.make("pi2", begins=8, ends=3600)
    async with (
        router(free_port, fleet.make("pi1"), at=at, dials=its) as one,
        router(free_port, early, at=its, dials=at, name="pi2"),
    ):
        assert "is valid from" in await why_not(its, fleet.make("pi1"))
        assert not one.linked()
        await until(lambda: one.linked() == {"pi2"}, "pi2 is linked when its certificate is valid")
