"""What the three daemons tell a service manager: real processes, a real notify socket, and the watchdog of systemd."""

import asyncio
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from commd.bus.bus import open_bus
from commd.client import join, parse
from schemas.wire import keys
from tests.support.notify_socket import NotifySocket
from tests.support.processes import running

MISSION = """\
mission: told
agents:
  thinker: {program: thinker.asl, robot: uav1}
clients: {somebody: {}}
robots:
  uav1: {manifest: copter, link: "udpin:127.0.0.1:PORT"}
done: "thinker: over"
"""
THINKER = """\
+!hang <- ?busy.
busy :- .range(A, 1, 1000000) & .range(B, 1, 1000000) & .sort([9,7,8,6,4,5,3,1,2,19,17,18,16,14,15,13,11,12], L)
    & L == A.
"""
"""Its plan has one formula, which takes ten seconds and more on any machine, and then more steps than it may."""
WATCHDOG = 2.0
"""Seconds, as `WatchdogSec=` would say."""


@pytest.fixture
def mission(tmp_path: Path, free_port: object) -> str:
    assert callable(free_port)
    (tmp_path / "thinker.asl").write_text(THINKER)
    (tmp_path / "m.yaml").write_text(MISSION.replace("PORT", str(free_port())))
    return str(tmp_path / "m.yaml")


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[NotifySocket]:
    with NotifySocket(tmp_path / "notify") as socket:
        yield socket


def tokens(endpoint: str, name: str, daemon: str) -> list[str]:
    """The liveliness tokens of a daemon that are there now."""

    async def ask() -> list[str]:
        async with open_bus(endpoint, fleet="told", name="looks", daemon="test") as bus:
            return await bus.tokens(keys.alive("told", name, daemon, "*"))

    return asyncio.run(ask())


def ready(manager: NotifySocket) -> None:
    manager.until(lambda: manager.fields("READY") == ["1"], "READY=1 comes, once")


def test_commd_is_ready_with_its_router_and_its_token(mission: str, manager: NotifySocket, endpoint: str) -> None:
    environment = manager.environment(watchdog=WATCHDOG)
    with running("commd", "serve", mission, "--router", endpoint, environment=environment) as commd:
        ready(manager)
        assert tokens(endpoint, "local", "commd")
        assert manager.fields("STATUS")[-1] == f"router of local at {endpoint}"
        manager.until(lambda: len(manager.fields("WATCHDOG")) >= 3, "its watchdog is fed while nothing happens")
        commd.signal(signal.SIGTERM)
        assert commd.ends() == 0
        assert manager.fields("STOPPING") == ["1"]


@pytest.mark.parametrize(("daemon", "name"), [("agentd", "thinker"), ("bridged", "uav1")])
def test_agentd_and_bridged_wait_for_the_router_in_words_and_are_ready_with_it(
    mission: str, manager: NotifySocket, endpoint: str, daemon: str, name: str
) -> None:
    environment = manager.environment(watchdog=WATCHDOG)
    with running(daemon, "serve", mission, "--router", endpoint, environment=environment) as process:
        manager.until(
            lambda: manager.fields("STATUS") == [f"waiting for the router at {endpoint}"], "it says what it waits for"
        )
        process.says("waiting for the router")
        assert not manager.fields("READY")
        with running("commd", "serve", mission, "--router", endpoint):
            ready(manager)
            assert tokens(endpoint, name, daemon)
            manager.until(lambda: len(manager.fields("WATCHDOG")) >= 3, "its watchdog is fed while nothing happens")
            process.signal(signal.SIGTERM)
            assert process.ends() == 0
            assert manager.fields("STOPPING") == ["1"]


def test_the_status_of_bridged_tells_of_an_unheard_vehicle(mission: str, manager: NotifySocket, endpoint: str) -> None:
    with (
        running("commd", "serve", mission, "--router", endpoint),
        running("bridged", "serve", mission, "--router", endpoint, environment=manager.environment()),
    ):
        manager.until(
            lambda: any("uav1: no heartbeat from system 1" in text for text in manager.fields("STATUS")),
            "the status says that nothing is heard of the vehicle",
        )


def test_a_mind_that_hangs_is_not_fed_and_its_process_lives(mission: str, manager: NotifySocket, endpoint: str) -> None:
    with (
        running("commd", "serve", mission, "--router", endpoint),
        running(
            "agentd", "serve", mission, "--router", endpoint, environment=manager.environment(watchdog=WATCHDOG)
        ) as agentd,
    ):
        ready(manager)
        manager.until(lambda: len(manager.fields("WATCHDOG")) >= 2, "its watchdog is fed")
        asyncio.run(tell(endpoint, mission, "hang"))
        manager.until(lambda: silent(manager), "its watchdog is fed no more once a plan of it never ends", seconds=60)
        assert agentd.process.poll() is None


def silent(manager: NotifySocket) -> bool:
    """Whether no feeding comes within the time after which systemd takes the process for hung."""
    before, end = len(manager.fields("WATCHDOG")), time.monotonic() + WATCHDOG
    while time.monotonic() < end:
        time.sleep(0.1)
        if len(manager.fields("WATCHDOG")) != before:
            return False
    return True


async def tell(endpoint: str, mission: str, goal: str) -> None:
    """Send the thinker a goal, as a member of its team."""
    async with join("somebody", mission=mission, router=endpoint) as me:
        await me.send("thinker", "achieve", parse(goal))
