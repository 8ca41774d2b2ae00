"""Which connections of other machines reach a router, and which sessions stay; the router is a plain server here."""

import asyncio
import re
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import cast

import pytest

from commd.bus.bus import Bus
from commd.bus.connect_diagnosis import attempt
from commd.bus.errors import BusClosed
from commd.bus.session import owner_of, session_config, session_id
from commd.router import admission as module
from commd.router.admission import ALLOWANCE, FORGED, Admission, open_admission
from commd.router.relay import counted_as
from schemas.mission.model import read_mission
from tests.support.buses import until
from tests.support.fleet_keys import FleetKeys

HELLO = bytes((22, 3, 1, 0, 4, 1, 0, 0, 0))
"""The shortest thing that is taken for a ClientHello."""
STRANGER = "127.0.0.66"
"""An address of no board."""
MISSION = """
mission: m
security: {operators: [ops], observers: [eye]}
boards: {pi1: {address: 127.0.0.1}, pi2: {address: 10.0.0.2}}
agents: {a: {board: pi1, program: a.asl}}
"""


@pytest.fixture(scope="module")
def fleet_keys(tmp_path_factory: pytest.TempPathFactory) -> FleetKeys:
    return FleetKeys(tmp_path_factory.mktemp("keys"))


Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]
Port = Callable[[], int]


class NoBus:
    """A router's session that tells of no links by itself."""

    def on_link(self, handler: Callable[[str, str, str, bool], None]) -> None:
        pass


class Front:
    """An admission, and what reached the router behind it."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.admission = Admission([f"tls/127.0.0.1:{port}"], read_mission(MISSION, Path("m.yaml")))
        self.reached: list[Streams] = []
        self.hangs_up = False

    async def take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection as the router does: it hangs up, or waits for what comes."""
        await reader.readexactly(len(HELLO))
        self.reached.append((reader, writer))
        if self.hangs_up:
            writer.close()

    async def dial(self, said: bytes = HELLO, address: str = "127.0.0.1") -> Streams:
        """Connect as another machine does, which has this address."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port, local_addr=(address, 0))
        writer.write(said)
        return reader, writer

    async def session(self, name: str, zid: str = "b0") -> tuple[Streams, Streams]:
        """Become a session; returns our end and the router's."""
        before = len(self.reached)
        ours = await self.dial()
        await until(lambda: len(self.reached) > before, "it reaches the router")
        host, port = self.reached[-1][1].get_extra_info("peername")
        self.admission.linked(zid, f"tls/{host}:{port}", name, True)
        return ours, self.reached[-1]


@asynccontextmanager
async def front(port: int) -> AsyncIterator[Front]:
    made = Front(port)
    servers = []
    for inner in made.admission.inner:
        host, number = re.fullmatch(r"tls/(.+):(\d+)", inner).groups()  # type: ignore[union-attr]
        servers.append(await asyncio.start_server(made.take, host, int(number)))
    async with open_admission(made.admission, cast(Bus, NoBus())):
        await until(lambda: _listens(port), "it listens")
        yield made
    for _, writer in made.reached:
        writer.close()
    for server in servers:
        server.close()


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture
def made(free_port: Port) -> AbstractAsyncContextManager[Front]:
    return front(free_port())


async def closed(streams: Streams) -> bytes:
    """Wait until the other side has closed a connection, and return what it said."""
    try:
        return await asyncio.wait_for(streams[0].read(), 120)
    except ConnectionError:
        return b""


async def test_what_a_session_says_is_passed_on_both_ways_and_takes_nothing_of_the_allowance(made: Front) -> None:
    for _ in range(3 * int(ALLOWANCE)):
        (reader, writer), (there_reader, there_writer) = await made.session("pi2")
        writer.write(b"there")
        assert await there_reader.readexactly(5) == b"there"
        there_writer.write(b"and back")
        assert await reader.readexactly(8) == b"and back"


async def test_who_says_no_client_hello_reaches_no_router(free_port: Port, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "HELLO", 0.2)
    async with front(free_port()) as made:
        silent, other = await made.dial(b""), await made.dial(b"GET / HTTP/1.1")
        assert (await closed(silent), await closed(other)) == (b"", b"")
        assert made.reached == []
        await until(lambda: made.admission.health().counters["unheard"] == 1, "the silent one is counted")


async def test_of_too_many_that_say_nothing_the_oldest_goes_and_who_says_hello_comes_in(
    free_port: Port, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "UNHEARD", 8)
    async with front(free_port()) as made:
        silent = [await made.dial(b"") for _ in range(20)]
        await made.session("ops")
        assert await closed(silent[0]) == b""
        assert not silent[-1][0].at_eof()


async def test_an_address_whose_handshakes_fail_is_told_to_wait_and_the_diagnosis_says_so(
    free_port: Port, fleet_keys: FleetKeys, monkeypatch: pytest.MonkeyPatch
) -> None:
    tls = fleet_keys.make("pi2")
    for figure in ("KNOWN_ALLOWANCE", "KNOWN_REFILL", "REFILL"):
        monkeypatch.setattr(module, figure, 0.0)
    async with front(free_port()) as made:
        made.hangs_up = True
        said = [await closed(await made.dial()) for _ in range(2 * int(ALLOWANCE))]
        assert said[0] == b""
        assert said[-1][:1] == bytes((21,)), "a TLS alert"
        assert len(made.reached) < 2 * ALLOWANCE
        words = await asyncio.to_thread(attempt, f"tls/127.0.0.1:{made.port}", tls)
        assert words.startswith("it takes no more handshakes from this address for some seconds")


@pytest.mark.parametrize(
    ("address", "forged", "shares"),
    [("127.0.0.1", False, True), ("127.0.0.1", True, False), (STRANGER, False, False)],
    ids=["known", "known, and came with another's id", "unknown"],
)
async def test_known_addresses_share_an_allowance_beyond_their_own(
    free_port: Port, monkeypatch: pytest.MonkeyPatch, address: str, forged: bool, shares: bool
) -> None:
    monkeypatch.setattr(module, "REFILL", 0.0)
    monkeypatch.setattr(module, "KNOWN_ALLOWANCE", 20.0)
    monkeypatch.setattr(module, "KNOWN_REFILL", 0.0)
    async with front(free_port()) as made:
        if forged:
            false, _ = await made.session("eye", session_id("pi2"))
            await closed(false)
        made.hangs_up, before = True, len(made.reached)
        for _ in range(40):
            await closed(await made.dial(address=address))
        own = 0 if forged else ALLOWANCE
        assert len(made.reached) - before == own + (20 if shares else 0)


@pytest.mark.parametrize(("owner", "whose"), [("pi2", "of `pi2`"), ("", "of this board's daemons")])
async def test_who_comes_with_another_machines_id_is_cut_off_and_told(made: Front, owner: str, whose: str) -> None:
    own, _ = await made.session("eye", session_id("eye"))
    false, _ = await made.session("eye", session_id(owner))
    assert await closed(false) == b""
    (note,) = made.admission.health().notes
    assert note.identity == (FORGED, f"eye 127.0.0.1 {owner or 'board'}")
    assert f"used the session id {whose}" in note.text
    assert made.admission.health().counters[FORGED] == 1
    assert not own[0].at_eof()


@pytest.mark.parametrize(("name", "comes_again"), [("eye", False), ("ops", True)])
async def test_who_does_not_read_loses_the_session_and_an_observer_comes_no_more_for_a_while(
    made: Front, name: str, comes_again: bool
) -> None:
    (reader, writer), (_, router) = await made.session(name)
    reader._transport.pause_reading()  # type: ignore[attr-defined]
    router.write(bytes(40_000_000))
    await until(lambda: made.admission.health().counters.get("stalled") == 1, "it is cut off")
    writer.close()
    again, (_, router) = await made.session(name)
    if comes_again:
        router.write(b"welcome")
        assert await again[0].readexactly(7) == b"welcome"
    else:
        assert await closed(again) == b""


async def test_a_board_that_pauses_reading_keeps_its_session(made: Front, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "STALLED", 0.1)
    (reader, writer), (_, router) = await made.session("pi2")
    reader._transport.pause_reading()  # type: ignore[attr-defined]
    router.write(bytes(40_000_000))
    await asyncio.sleep(3 * module.STALLED)
    reader._transport.resume_reading()  # type: ignore[attr-defined]
    assert len(await reader.readexactly(40_000_000)) == 40_000_000
    writer.close()


async def test_one_certificate_has_so_many_sessions_no_more(free_port: Port, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MOST_SESSIONS", 2)
    async with front(free_port()) as made:
        two = [await made.session("eye") for _ in range(2)]
        third, _ = await made.session("eye")
        assert await closed(third) == b""
        two[0][0][1].close()
        await until(lambda: made.admission._sessions["eye"] == 1, "one has ended")
        (_, writer), (there, _) = await made.session("eye")
        writer.write(b"in")
        assert await there.readexactly(2) == b"in"


async def test_another_program_at_the_boards_address_is_an_error(made: Front) -> None:
    other = Admission([f"tls/127.0.0.1:{made.port}"], read_mission(MISSION, Path("m.yaml")))
    with pytest.raises(BusClosed, match="Address already in use: is another router running there"):
        await other.begin()


def test_ids_say_whose_they_are(fleet_keys: FleetKeys) -> None:
    names = ["pi1", "pi2", "eye"]
    assert [owner_of(session_id(name), names) for name in (*names, "", "else")] == [*names, "", None]
    assert session_id("pi1") != session_id("pi1")
    daemon = session_config("client", "unixsock-stream//run/x.sock", "x")
    machine = session_config("client", "tls/127.0.0.1:7447", "x", tls=fleet_keys.make("pi2"))
    ids = [config.get_json("id").strip('"') for config in (daemon, machine)]
    assert [owner_of(zid, names) for zid in ids] == ["", "pi2"]


@pytest.mark.parametrize(
    ("peer", "counts_as"),
    [
        (("10.0.0.66", 5), "10.0.0.66"),
        (("::ffff:10.0.0.66", 5), "10.0.0.66"),
        (("fd00:1:2:3:4:5:6:7", 5), "fd00:1:2:3::/64"),
        (("fe80::1%eth0", 5), "fe80::/64"),
        (None, "?"),
    ],
)
def test_an_address_counts_and_of_ipv6_its_network(peer: tuple[str, int] | None, counts_as: str) -> None:
    assert counted_as(peer) == counts_as
