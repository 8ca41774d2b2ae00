"""The observer of a run, and the log of a daemon, when the router goes and comes back."""

from __future__ import annotations

import asyncio
import re
import time
from pathlib import Path

import pytest

from argosy.cli.journal import Journal
from argosy.fleet_model.picture import Picture
from argosy.fleet_model.snapshot import Observer
from commd.bus.bus import open_bus
from commd.common import repeated_log
from schemas.mission.model import read_mission
from schemas.wire import keys
from schemas.wire.records import Perception
from tests.support.buses import FLEET, Connect, on_a_bus, session, subscribed, until

MISSION = f"mission: {FLEET}\nagents: {{a: {{program: a.asl}}}}\n"


def test_that_the_router_is_away_and_back_is_told_in_the_run_and_in_the_log(
    endpoint: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(repeated_log, "AGAIN", (0.05, 0.1, 600.0))
    caplog.set_level("INFO")
    journal = Journal(lambda: 0.0)
    picture = Picture(read_mission(MISSION, Path("m.yaml")), journal, lambda: 0.0)

    def said(word: str) -> bool:
        return any(re.search(word, entry.text) for entry in journal.entries)

    async def body() -> None:
        async with asyncio.timeout(240):
            waiting = open_bus(endpoint, fleet=FLEET, name="argosy", daemon="argosy", stamp=time.time_ns)
            opening = asyncio.create_task(waiting.__aenter__())
            await until(
                lambda: len(re.findall(r"waiting for the router at \S+ for=", caplog.text)) == 2, "it is said again"
            )
            router = session(endpoint, "board", "commd", router=True)
            await router.__aenter__()
            bus = await opening
            await until(lambda: bus.router_up, "the router is seen")
            Observer(bus, picture)
            assert not said("answer")
            await router.__aexit__(None, None, None)
            await until(lambda: said("the router does not answer"), "the run is told")
            await until(lambda: "router lost for=" in caplog.text, "the log says it again")
            async with session(endpoint, "board", "commd", router=True):
                await until(lambda: said(r"the router answers again, after \d+\.\d s"), "the run is told")
                await waiting.__aexit__(None, None, None)

    asyncio.run(body())
    assert re.search(r"router back after=\d+\.\ds", caplog.text)
    assert caplog.text.count("router up") == 1


def test_what_an_agent_is_told_by_hand_is_not_taken_for_its_vehicle(endpoint: str) -> None:
    robot = "robots: {r: {manifest: arducopter, link: x}}"
    text = MISSION.replace("a.asl", "a.asl, robot: r") + robot
    picture = Picture(read_mission(text, Path("m.yaml")), Journal(lambda: 0.0), lambda: 0.0)

    async def body(connect: Connect) -> None:
        Observer(await connect("argosy", "argosy"), picture)
        bridge, key = await connect("r", "bridged"), keys.percept(FLEET, "a", "altitude")
        await subscribed(bridge, key)
        bridge.put(key, Perception(header=bridge.header("percepts"), name="altitude", parameters=(5.0,)))
        await until(lambda: picture.robots["r"].altitude == 5.0, "the vehicle's altitude is seen")
        bridge.put(key, Perception(parameters=(99.0,)))
        bridge.put(key, Perception(header=bridge.header("percepts"), name="altitude", parameters=(6.0,)))
        await until(lambda: picture.robots["r"].altitude != 5.0, "the next one is seen")
        assert picture.robots["r"].altitude == 6.0

    on_a_bus(endpoint, body)
