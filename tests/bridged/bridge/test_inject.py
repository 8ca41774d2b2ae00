"""Actions asked for by hand, over a real bus: refused unless the mission says `inject: true`, then as an agent's."""

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from bridged.bridge.action_server import BY_HAND, is_by_hand
from commd.bus.bus import Bus
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Cancel, Header
from tests.bridged.airfield import serving, until
from tests.bridged.sky import MISSION, Sky
from tests.support.buses import arrived

INJECT = f"{MISSION}inject: true\n"


def asked(bus: Bus, name: str, payload: bytes, agent: str = "uav") -> list[dict[str, Any]]:
    """Ask with the bytes of a person, without an Encoding; return all replies."""
    selector = f"{keys.action('test', agent, name)}?_time=[..]"  # Zenoh keeps replies together without a time
    return [
        json.loads(reply.ok.payload.to_bytes()) if reply.ok else {"error": reply.err.payload.to_string()}
        for reply in bus._session.get(selector, payload=payload, timeout=30)
    ]


async def flying(bus: Bus, action: Action) -> tuple[asyncio.Task[None], list[ActionStatus]]:
    """Ask for a `goto` and wait until it runs; returns what ends with it, and its statuses so far."""
    heard: list[ActionStatus] = []

    async def fly() -> None:
        async for reply in bus.query(keys.action("test", "uav", "goto"), action, ActionStatus, 60):
            assert reply.record is not None, reply.error
            heard.append(reply.record)

    flight = asyncio.create_task(fly())
    await until(lambda: any(one.state == "running" for one in heard), "it flies")
    return flight, heard


def test_an_agent_is_known_by_its_id_and_its_name() -> None:
    its_own = Header(source="uav")
    assert not is_by_hand("uav", Action(header=its_own, id="uav:b:1"))
    assert is_by_hand("uav", Action())
    assert is_by_hand("uav", Action(header=its_own))
    assert is_by_hand("uav", Action(id="uav:b:1"))
    assert is_by_hand("uav", Action(header=Header(source="operator"), id="operator:b:1"))


def test_who_cancels_without_a_name_is_not_the_agent_whatever_that_is_called(tmp_path: Path) -> None:
    server = Sky(tmp_path, mission=MISSION.replace("uav:", "hand:")).bridge.action_server
    assert server.cancel("hand", "hand:b:1", "", inject=False).reason == BY_HAND
    assert server.cancel("hand", "hand:b:1", "hand", inject=False).reason == "no action hand:b:1 of hand"


async def test_without_inject_an_action_by_hand_is_refused_by_the_fields_name(endpoint: str, tmp_path: Path) -> None:
    async with serving(endpoint, tmp_path) as (field, bus), field.client("operator") as person:
        told: list[ActionStatus] = []
        bus.subscribe(keys.status("test", "uav", "*"), ActionStatus, lambda _, one: told.append(one))
        await arrived(bus)
        [refused] = await asyncio.to_thread(asked, person, "arm_motors", b'{"parameters": [true]}')
        assert (refused["state"], refused["result"], refused["reason"]) == ("refused", False, BY_HAND)
        assert "inject: true" in BY_HAND
        await until(lambda: [one.reason for one in told] == [BY_HAND], "observers are told, too")
        assert not field.vehicle.autopilot.armed
        assert (await field.do(bus, "set_mode", "GUIDED")).state == "succeeded", "the agent acts as ever"


async def test_with_inject_what_is_missing_is_filled_in_and_every_status_comes(endpoint: str, tmp_path: Path) -> None:
    async with serving(endpoint, tmp_path, mission=INJECT) as (field, _bus), field.client("operator") as person:
        for name, payload in (("set_mode", b'{"parameters":["GUIDED"]}'), ("arm_motors", b'{"parameters":[true]}')):
            statuses = await asyncio.to_thread(asked, person, name, payload)
            assert statuses[-1]["state"] == "succeeded", statuses
        statuses = await asyncio.to_thread(asked, person, "takeoff", b'{"parameters": [20]}')
        states = [one["state"] for one in statuses]
        assert states[0] == "accepted"
        assert set(states[1:-1]) == {"running"}
        assert states[-1] == "succeeded"
        assert "altitude" in statuses[1]["feedback"]
        [identity] = {one["id"] for one in statuses}
        assert identity.startswith("uav:")
        refused = await asyncio.to_thread(asked, person, "takeoff", b'{"parameters": [500]}')
        assert "expected altitude: float 1..120 m, got 500" in refused[-1]["reason"]
        described = await asyncio.to_thread(asked, person, "takeoff", b"5 m")
        assert described[0]["signature"] == "takeoff(altitude: float 1..120 m)"
        assert "Action:" in described[0]["problem"]


async def test_an_action_by_hand_stands_under_the_lease_and_can_be_cancelled(endpoint: str, tmp_path: Path) -> None:
    async with serving(endpoint, tmp_path, mission=INJECT) as (field, bus), field.client("operator") as person:
        await field.take_off(bus)
        [refused] = await asyncio.to_thread(asked, person, "land", b'{"parameters":[]}', "other")
        assert refused["reason"].startswith("held by uav for ")
        mine = Action(
            header=Header(source="operator"), id="operator:x:1", parameters=(-27.600, -48.515, 20)
        )  # 500 m away
        flight, running = await flying(person, mine)
        busy = await field.do(bus, "goto", -27.601, -48.515, 20)
        assert busy.reason == "busy: goto is running"
        end = Cancel(header=Header(source="operator"), id="operator:x:1")
        ended = person.query(keys.cancel("test", "uav"), end, ActionStatus, 10)
        assert [reply.record.state async for reply in ended if reply.record] == ["cancelled"]
        await flight
        assert (running[-1].state, running[-1].reason) == ("cancelled", "cancelled by operator")


@pytest.mark.parametrize("inject", [True, False])
async def test_an_agents_action_is_cancelled_by_hand_where_allowed(endpoint: str, tmp_path: Path, inject: bool) -> None:
    async with (
        serving(endpoint, tmp_path, mission=INJECT if inject else MISSION) as (field, bus),
        field.client("operator") as person,
    ):
        await field.take_off(bus)
        its_own = Action(header=Header(source="uav"), id="uav:b:9", parameters=(-27.600, -48.515, 20))
        flight, told = await flying(bus, its_own)

        async def cancel(source: str) -> ActionStatus:
            end = Cancel(header=Header(source=source), id="uav:b:9")
            async for reply in person.query(keys.cancel("test", "uav"), end, ActionStatus, 10):
                assert reply.record is not None, reply.error
                return reply.record
            raise AssertionError("nobody answers")

        if inject:
            assert (await cancel("")).state == "cancelled"
            await flight
            assert told[-1].reason == "cancelled by hand", "the agent is not told that it did so itself"
        else:
            for source in ("", "operator"):
                refused = await cancel(source)
                assert (refused.state, refused.reason) == ("refused", BY_HAND)
            assert not any(one.final for one in told), "it flies on"
            assert (await cancel("uav")).reason == "cancelled by uav"
            await flight


@pytest.mark.parametrize("payload", [b'{"parameters":[],"name":"land"}', b'{"parameters":[],"agent":"other"}'])
async def test_what_contradicts_its_key_is_refused(endpoint: str, tmp_path: Path, payload: bytes) -> None:
    async with serving(endpoint, tmp_path, mission=INJECT, client="operator") as (_field, person):
        [refused] = await asyncio.to_thread(asked, person, "return_to_launch", payload)
        assert "the key says uav/return_to_launch, the action says " in refused["reason"]
