"""The routers of several boards: where they listen, whom they dial, and what happens when one is away."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.bus.router_endpoints import missing_addresses, router_of
from commd.router.link_watchdog import LinkWatchdog
from schemas.mission.model import read_mission
from schemas.wire import keys
from tests.support.buses import FLEET, session, until

THREE = """\
mission: three
boards:
  pi1: {address: 10.0.0.11}
  pi2: {address: "10.0.0.12:7500"}
  pi3: {address: "[fd00::3]:7447"}
agents:
  a: {program: a.asl, board: pi1}
"""
LOCAL = "tcp/127.0.0.1:7447"
NOWHERE = "tcp/192.0.2.1:7447"
"""An address for documentation: no machine has it."""

Port = Callable[[], int]


def of(board: str, text: str = THREE, endpoint: str = LOCAL) -> tuple[list[str], list[str]]:
    return router_of(read_mission(text, Path("m.yaml")), board, endpoint)


def test_a_board_listens_at_its_address_and_dials_the_boards_before_it() -> None:
    assert of("pi1") == (["tcp/10.0.0.11:7447"], [])
    assert of("pi2") == (["tcp/10.0.0.12:7500"], ["tcp/10.0.0.11:7447"])
    assert of("pi3") == (["tcp/[fd00::3]:7447"], ["tcp/10.0.0.11:7447", "tcp/10.0.0.12:7500"])


def test_a_board_without_an_address_listens_for_nobody_and_dials_all_that_have_one() -> None:
    text = THREE.replace('pi2: {address: "10.0.0.12:7500"}', "pi2: {}")
    assert of("pi2", text) == ([], ["tcp/10.0.0.11:7447", "tcp/[fd00::3]:7447"])
    assert of("pi3", text) == (["tcp/[fd00::3]:7447"], ["tcp/10.0.0.11:7447"])


def test_a_mission_of_one_machine_listens_on_loopback_alone() -> None:
    alone = "mission: one\nagents:\n  a: {program: a.asl}\n"
    assert of("local", alone) == ([], [])


def test_a_router_does_not_listen_twice_at_its_own_endpoint() -> None:
    assert of("pi1", endpoint="tcp/10.0.0.11:7447") == ([], [])


async def test_what_another_board_says_is_heard_in_whatever_order_the_routers_come(free_port: Port) -> None:
    here, there, link = (f"tcp/127.0.0.1:{free_port()}" for _ in range(3))

    @asynccontextmanager
    async def first() -> AsyncIterator[Bus]:
        """Run the other board; its router may be one of those that hear nothing, and is then linked again."""
        async with session(there, "pi1", "commd", router=True, listen=[link]) as router, session(there, "a") as agent:
            watchdog = asyncio.create_task(LinkWatchdog(router, ["pi2"], [link]).run())
            try:
                yield agent
            finally:
                watchdog.cancel()

    async with session(here, "pi2", "commd", router=True, connect=[link]) as second, session(here, "b") as b:
        await second.claim("pi2")
        await b.claim("b")
        assert await second.tokens(keys.alive(FLEET, "b", "agentd", "*")) == [keys.alive(FLEET, "b", "agentd", b.boot)]
        async with first() as a:
            await sees(a, "b")
            await a.claim("a")
            await sees(b, "a")
        await until_gone(b, "a")
        async with first() as a:
            await sees(a, "b")


async def sees(bus: Bus, agent: str) -> None:
    """Wait until an agent's token is seen."""
    there: set[str] = set()
    bus.watch(keys.alive(FLEET, agent, "agentd", "*"), lambda key, alive: there.add(key) if alive else None)
    await until(lambda: bool(there), f"{bus.name} sees {agent}")


async def until_gone(bus: Bus, agent: str) -> None:
    """Wait until no token of an agent is seen."""

    async def gone() -> bool:
        return not await bus.tokens(keys.alive(FLEET, agent, "agentd", "*"))

    await until(gone, f"no token of {agent}")


async def test_an_address_that_this_machine_does_not_have_yet_keeps_no_board_from_starting(
    endpoint: str, caplog: pytest.LogCaptureFixture
) -> None:
    async with session(endpoint, "pi1", "commd", router=True, listen=[NOWHERE]), session(endpoint, "a") as a:
        await a.claim("a")
    assert f"{NOWHERE} is no address of this machine yet" in caplog.text


@pytest.mark.parametrize("late", [[], [NOWHERE]], ids=["all there", "one to come"])
def test_an_endpoint_that_is_taken_ends_the_router_at_once(free_port: Port, late: list[str]) -> None:
    here, link = f"tcp/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{free_port()}"

    async def start(endpoint: str, *listen: str) -> None:
        async with session(endpoint, "pi1", "commd", router=True, listen=listen):
            raise AssertionError("it started")

    with socket.create_server(("127.0.0.1", int(link.rpartition(":")[2]))):
        with pytest.raises(BusClosed, match=f"cannot listen at {link}: Address already in use: is another router"):
            asyncio.run(asyncio.wait_for(start(here, link, *late), 240))
        with pytest.raises(BusClosed, match=f"cannot listen at {link}"):
            asyncio.run(asyncio.wait_for(start(link, *late), 240))


def test_a_name_that_nobody_knows_may_be_known_later() -> None:
    unknown = "tcp/no-such-host.invalid:7447"
    assert asyncio.run(missing_addresses("unixsock-stream//run/y", [unknown, "unixsock-stream//run/x"])) == [unknown]


def test_a_router_whose_own_address_is_missing_does_not_start() -> None:
    with pytest.raises(BusClosed, match=r"cannot listen at tcp/192\.0\.2\.1:7447: no address of this machine"):
        asyncio.run(missing_addresses("tcp/192.0.2.1:7447", [NOWHERE]))
