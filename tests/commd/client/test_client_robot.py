"""A program in Python that has a robot: it perceives and acts as an agent does, by a real bridge and a turtle."""

import asyncio
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from commd.bus.bus import Query
from commd.client import Client, join
from schemas.mission.model import Mission, load_mission, read_mission
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Cancel
from tests.bridged.studio import Studio, in_the_studio
from tests.support.buses import Connect, served, until

MISSION = """
mission: turtle
agents: {artist: {program: turtle/turtle.asl}}
clients: {driver: {robot: turtle}}
robots:
  turtle: {manifest: turtle, on_agent_loss: [hold], on_shutdown: hold, simulate: {vehicle: turtle}}
"""


@pytest.fixture
def mission() -> Mission:
    return read_mission(MISSION, Path(load_mission("missions/turtle.yaml").path))


@asynccontextmanager
async def in_the_studio_of(endpoint: str, folder: Path, mission: Mission) -> AsyncIterator[tuple[Client, Studio]]:
    """Yield the client whose robot is a simulated turtle."""
    async with (
        in_the_studio(endpoint, folder, mission=mission) as studio,
        join("driver", mission=mission, router=endpoint) as me,
    ):
        yield me, studio


async def test_a_client_sees_what_its_robot_does(endpoint: str, tmp_path: Path, mission: Mission) -> None:
    async with in_the_studio_of(endpoint, tmp_path, mission) as (me, studio):
        percepts = me.percepts()
        assert await percepts.until(lambda seen: bool(seen.of("pose")), 20)
        heard: list[ActionStatus] = []
        status = await me.perform("teleport", 2, 3.5, 0, on_status=heard.append)
        assert (status.state, status.result) == ("succeeded", True)
        assert heard
        assert not any(one.final for one in heard)
        assert await percepts.until(lambda seen: seen.of("pose") == [(2.0, 3.5, 0.0)], 20)
        assert (studio.turtle.x, studio.turtle.y) == (2.0, 3.5)
        names = set[str]()
        async for change in percepts:
            names.add(change.name)
            if {"pose", "velocity"} <= names:
                break


async def test_what_the_robot_refuses_is_a_status_no_exception(endpoint: str, tmp_path: Path, mission: Mission) -> None:
    async with in_the_studio_of(endpoint, tmp_path, mission) as (me, _):
        assert await me.percepts().until(lambda seen: bool(seen.of("pose")), 20)
        status = await me.perform("set_pen", 1, 2, 999, 1, False)
        assert (status.state, status.result) == ("refused", False)
        assert "999" in status.reason
        status = await me.perform("fly", math.inf)
        assert status.state == "refused"


async def test_a_robot_is_held_when_its_program_is_gone(
    endpoint: str, tmp_path: Path, mission: Mission, caplog: pytest.LogCaptureFixture
) -> None:
    async with in_the_studio(endpoint, tmp_path, mission=mission):
        async with join("driver", mission=mission, router=endpoint) as me:
            assert await me.percepts().until(lambda seen: bool(seen.of("pose")), 20)
            assert (await me.perform("cmd_vel", 0.5, 0, 0)).state == "succeeded"
        await until(lambda: "turtle agent driver is lost" in caplog.text, "the bridge misses the program")


async def test_an_action_that_is_given_up_is_cancelled(connect: Connect, endpoint: str, mission: Mission) -> None:
    bridge = await connect("turtle", "bridged")
    begun, cancelled = asyncio.Event(), list[str]()
    key, over = keys.action("turtle", "driver", "*"), asyncio.Event()

    async def act(query: Query[Action]) -> None:
        query.reply(ActionStatus(id=query.record.id, state="running"))
        begun.set()
        await over.wait()

    async def cancel(query: Query[Cancel]) -> None:
        cancelled.append(query.record.id)
        query.reply(ActionStatus(id=query.record.id, state="cancelled"))

    bridge.serve(key, Action, act)
    bridge.serve(keys.cancel("turtle", "driver"), Cancel, cancel)
    async with join("driver", mission=mission, router=endpoint) as me:
        await served(me._bus, keys.action("turtle", "driver", "dance"))
        dancing = asyncio.create_task(me.perform("dance"))
        await begun.wait()
        dancing.cancel()
        with pytest.raises(asyncio.CancelledError):
            await dancing
        assert len(cancelled) == 1
        assert cancelled[0].startswith("driver:")
        over.set()


async def test_who_has_no_robot_is_told_so(connect: Connect, endpoint: str, mission: Mission) -> None:
    async with join("driver", mission=mission, router=endpoint) as me:
        with pytest.raises(ValueError, match="`artist` has no robot in the mission"):
            me.percepts("artist")


async def test_changes_are_kept_for_loops_alone_and_each_begins_with_what_is_perceived(
    endpoint: str, tmp_path: Path, mission: Mission
) -> None:
    async with in_the_studio_of(endpoint, tmp_path, mission) as (me, _):
        percepts = me.percepts()
        assert await percepts.until(lambda seen: bool(seen.of("pose")), 20)
        assert await percepts.until(lambda seen: bool(seen.of("velocity")), 20)
        for _ in range(2):  # the second loop begins as the first has
            begun = [one.name async for one in limited(percepts, len(percepts.present()))]
            assert sorted(begun) == sorted(one.name for one in percepts.present())
        changes = aiter(percepts)
        for _ in percepts.present():
            await anext(changes)
        await me.perform("teleport", 2, 3.5, 0)
        async with asyncio.timeout(120):
            while (change := await anext(changes)).name != "pose":
                pass
        assert change.parameters == (2.0, 3.5, 0.0)
        assert len(percepts._loops) == 1
        await changes.aclose()
        assert percepts._loops == []
        assert percepts.of("nothing") == []


async def limited(percepts: Any, count: int) -> Any:
    changes = aiter(percepts)
    for _ in range(count):
        yield await anext(changes)
    await changes.aclose()
