"""New keys for one board while the others fly on, and boards and people who are disowned: real routers as deployed."""

import asyncio
import shutil
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field

import pytest

from argosy.__main__ import main as argosy
from commd.bus.bus import Bus, Query, open_bus
from commd.bus.connect_diagnosis import why_not
from commd.bus.tls import Tls, files_in
from commd.router import config as router_config
from schemas.wire import keys
from schemas.wire.records import Outcome, Perception, StopOrder
from tests.support.buses import until
from tests.support.secured import Secured

FLEET = "three"


@pytest.fixture
def fleet() -> Iterator[Secured]:
    with Secured() as made:
        yield made


@asynccontextmanager
async def router(fleet: Secured, board: str) -> AsyncIterator[Bus]:
    """The router of a board, by the configuration that `argosy units` writes."""
    config = router_config.read(fleet.config(board)).config
    endpoint = fleet.socket(board)
    options = {"fleet": FLEET, "name": board, "daemon": "commd", "mode": "router"}
    async with open_bus(endpoint, config=config, **options) as bus:  # type: ignore[arg-type]
        yield bus


@asynccontextmanager
async def member(fleet: Secured, board: str, name: str, daemon: str = "agentd") -> AsyncIterator[Bus]:
    """A daemon on a board."""
    options = {"fleet": FLEET, "name": name, "daemon": daemon, "patience": 20.0}
    async with open_bus(fleet.socket(board), **options) as bus:  # type: ignore[arg-type]
        yield bus


def keys_command(fleet: Secured, *command: str) -> None:
    name, *rest = command
    assert argosy(["keys", name, str(fleet.path), *rest, "--dir", str(fleet.folder / "keys")]) == 0


async def verdict(at: str, tls: Tls) -> str:
    """What a router says of somebody's keys, once it listens for other machines: it does so a little after it opens."""
    found: list[str] = []

    async def listens() -> bool:
        found.append(await why_not(at, tls))
        return not found[-1].startswith("is commd running?")

    await until(listens, f"a router listens at {at}")
    return found[-1]


@dataclass
class Flow:
    """Percepts from pi3 to pi2, one every few milliseconds."""

    sent: int = 0
    heard: list[int] = field(default_factory=list)


@asynccontextmanager
async def flow(fleet: Secured) -> AsyncIterator[Flow]:
    """Let an agent of pi3 be told of, and an agent of pi2 listen, all the while."""
    counted = Flow()
    async with member(fleet, "pi2", "b") as listener, member(fleet, "pi3", "c", "bridged") as teller:
        listener.subscribe(
            keys.percept(FLEET, "c", "*"), Perception, lambda _, said: counted.heard.append(said.header.seq)
        )

        async def tell() -> None:
            while True:
                teller.put(keys.percept(FLEET, "c", "x"), Perception(header=teller.header("percept"), name="x"))
                counted.sent += 1
                await asyncio.sleep(0.005)

        telling = asyncio.create_task(tell())
        await until(lambda: bool(counted.heard), "percepts of c reach b")
        try:
            yield counted
        finally:
            telling.cancel()


async def test_a_board_gets_new_keys_and_the_others_do_not_miss_a_word(fleet: Secured) -> None:
    async with AsyncExitStack() as stack:
        buses = {board: await stack.enter_async_context(router(fleet, board)) for board in ("pi2", "pi3")}
        async with router(fleet, "pi1") as first:
            await until(lambda: first.linked() == {"pi2", "pi3"}, "pi1 is linked to both")
            await until(lambda: buses["pi2"].linked() == {"pi1", "pi3"}, "all are linked")
            counted = await stack.enter_async_context(flow(fleet))
            before = fleet.tls("pi1").certificate.read_bytes()
            keys_command(fleet, "renew", "pi1")
            assert fleet.tls("pi1").certificate.read_bytes() != before
        await until(lambda: buses["pi2"].linked() == {"pi3"}, "pi1 is away")
        async with router(fleet, "pi1") as again:
            await until(lambda: again.linked() == {"pi2", "pi3"}, "pi1 is back, with its new keys")
            await until(lambda: buses["pi3"].linked() == {"pi1", "pi2"}, "and known by all")
            last = counted.heard[-1]
            await until(lambda: counted.heard[-1] > last + 5, "percepts go on")
        heard = counted.heard
        assert heard == list(range(heard[0], heard[0] + len(heard))), "none was lost between pi3 and pi2"
        assert len(heard) > 20


async def test_a_revoked_board_is_refused_by_each_board_that_has_the_new_anchors(fleet: Secured) -> None:
    stolen = fleet.folder / "stolen"
    fleet.keys("pi3").rename(stolen)
    stolen_tls = files_in(stolen)
    async with router(fleet, "pi1") as one:
        async with router(fleet, "pi2") as two:
            await until(lambda: one.linked() == {"pi2"}, "pi1 and pi2 are linked")
            assert await verdict(fleet.link("pi1"), stolen_tls) == ""
            keys_command(fleet, "revoke", "pi3")
            assert await verdict(fleet.link("pi2"), stolen_tls) == "", "a router reads whom to believe when it starts"
        async with router(fleet, "pi2") as two:
            assert "does not believe the certificate of `pi3`" in await verdict(fleet.link("pi2"), stolen_tls)
            await until(lambda: one.linked() == {"pi2"}, "the new anchors and the old ones believe pi2")
            assert two.linked() == {"pi1"}
    async with router(fleet, "pi1") as one, router(fleet, "pi2"):
        for board in ("pi1", "pi2"):
            assert "does not believe the certificate of `pi3`" in await verdict(fleet.link(board), stolen_tls)
        await until(lambda: one.linked() == {"pi2"}, "both have the new anchors")
        keys_command(fleet, "add-board", "pi3")
    async with router(fleet, "pi1") as one, router(fleet, "pi2"), router(fleet, "pi3"):
        await until(lambda: one.linked() == {"pi2", "pi3"}, "another board of that name is one of them")
        assert "does not believe" in await verdict(fleet.link("pi1"), stolen_tls), "the stolen keys are none still"


async def test_operators_reach_each_board_by_its_own_router_and_revoked_ones_none(
    fleet: Secured, capsys: pytest.CaptureFixture[str]
) -> None:
    orders: list[str] = []

    def stop(*more: str, keys_of: str = "ops") -> int:
        where = ("--mission", str(fleet.path), "--keys", str(fleet.keys(keys_of)))
        return argosy(["stop", "land", *more, *where])

    async def bridge(stack: AsyncExitStack, board: str, robot: str) -> None:
        bus = await stack.enter_async_context(member(fleet, board, robot, "bridged"))

        async def told(query: Query[StopOrder]) -> None:
            orders.append(robot)
            query.reply(Outcome(ok=True))

        bus.serve(keys.stop(FLEET, robot), StopOrder, told)
        await bus.claim(robot)

    async with AsyncExitStack() as stack:
        one = await stack.enter_async_context(router(fleet, "pi1"))
        await bridge(stack, "pi1", "r1")
        async with router(fleet, "pi2") as two:
            await until(lambda: two.linked() == {"pi1"} and one.linked() == {"pi2"}, "they are linked")
            async with AsyncExitStack() as there:
                await bridge(there, "pi2", "r2")
                seen = keys.alive(FLEET, "r2", "bridged", "*")
                await until(lambda: one.tokens(seen), "r2 is seen at pi1")
                capsys.readouterr()
                assert await asyncio.to_thread(stop) == 1, "r3 was not stopped"
                assert sorted(orders) == ["r1", "r2"]
                said = sorted(capsys.readouterr().out.splitlines())
                assert said[:2] == ["r1: land confirmed", "r2: land confirmed"]
                assert said[2].startswith("r3: land NOT confirmed (board pi3 is not reached: ")
                assert await asyncio.to_thread(stop, "r1", keys_of="eye") == 1, "an observer stops nobody"
                assert "note: `eye` is an observer in the mission" in capsys.readouterr().err
                assert sorted(orders) == ["r1", "r2"]
        assert await asyncio.to_thread(stop, "r1") == 0, "one board is away, and the other is told"
        assert await asyncio.to_thread(argosy, ["mail", str(fleet.path), "--keys", str(fleet.keys("ops"))]) == 1
        assert f"pi2: board pi2 is not reached: no router at {fleet.link('pi2')}" in capsys.readouterr().err
        assert await asyncio.to_thread(stop, "r2") == 1
    kept = fleet.folder / "kept"
    shutil.copytree(fleet.keys("ops"), kept)
    keys_command(fleet, "revoke", "ops")
    async with router(fleet, "pi1"):
        assert "does not believe the certificate of `ops`" in await verdict(fleet.link("pi1"), files_in(kept))
    assert sorted(orders) == ["r1", "r1", "r2"]


def test_where_no_board_is_reached_each_says_why(fleet: Secured, capsys: pytest.CaptureFixture[str]) -> None:
    assert argosy(["stop", "land", "--mission", str(fleet.path), "--keys", str(fleet.keys("ops"))]) == 1
    said = capsys.readouterr().err
    assert "no board of the fleet is reached:" in said
    for board in ("pi1", "pi2", "pi3"):
        assert f"no router at {fleet.link(board)}: is commd running? Nobody listens there" in said


MISUSED: dict[str, tuple[tuple[str, ...], str]] = {
    "no board": (("--keys", "KEYS"), "--keys: error: need a board: add --mission FILE or --router tls/HOST:PORT"),
    "plain": (
        ("--keys", "KEYS", "--router", "tcp/127.0.0.1:1"),
        "need an endpoint tls/HOST:PORT, got --router tcp/127.0.0.1:1",
    ),
    "no keys": (("--router", "tls/127.0.0.1:1"), "it is reached with keys alone: say where they are by --keys FOLDER"),
    "nothing there": (("--keys", "nowhere", "--router", "tls/127.0.0.1:1"), "nowhere/ca.pem: error: cannot be read"),
}


@pytest.mark.parametrize("what", MISUSED)
def test_misused_keys_are_refused_in_words(fleet: Secured, capsys: pytest.CaptureFixture[str], what: str) -> None:
    options, words = MISUSED[what]
    given = [str(fleet.keys("ops")) if option == "KEYS" else option for option in options]
    assert argosy(["stop", "land", *given]) in (1, 2)
    assert words in capsys.readouterr().err
