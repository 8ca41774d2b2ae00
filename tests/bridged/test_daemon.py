"""The bridge daemon on real Zenoh, with a simulated copter on real UDP."""

import asyncio
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from bridged.daemon import serve
from commd.bus.bus import Bus, Query
from commd.bus.errors import AlreadyRunning
from commd.bus.raw import Publisher
from commd.client.percept_sync import PerceptSync
from commd.liveness.presence import Presence
from commd.process.process import EXIT_FAILED
from schemas.manifest.loader import ActionDescription
from schemas.manifest.model import Duration
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import Action, ActionStatus, Cancel, Health, Perception, Perceptions
from tests.bridged.airfield import (
    Airfield,
    all_present,
    on_the_airfield,
    restored,
    serving,
    until,
    until_served,
)
from tests.bridged.radio import BEAT, COPTER, Speaker, place, riding
from tests.bridged.sky import MISSION
from tests.support.buses import under_way
from tests.support.ports import free_port
from tests.support.processes import Daemon
from tests.support.promises import kept

GOAL = (-27.6039, -48.5182, 12)
HELD_AT_THE_END = MISSION.replace("    link:", "    on_shutdown: hold\n    link:")
FAR = (-27.600, -48.515, 20)
"""500 m away: 50 s and more of mission time."""


async def beginning(
    field: Airfield, bus: Bus, name: str, *parameters: float
) -> tuple[asyncio.Task[list[ActionStatus]], str]:
    """Ask for a long action and wait until it runs; returns the asker and the action's id."""
    statuses: list[ActionStatus] = []
    bus.subscribe(keys.status("test", "uav", name), ActionStatus, lambda _key, status: statuses.append(status))
    backfill = asyncio.create_task(field.ask(bus, name, *parameters))
    await until(lambda: any(one.state == "running" for one in statuses), f"{name} runs")
    return backfill, statuses[-1].id


def test_what_is_not_armed_leaves_within_a_second(endpoint: str, tmp_path: Path) -> None:
    async def leaving() -> float:
        async with serving(endpoint, tmp_path) as (field, _bus):
            started = time.monotonic()
            await field.leave()
            return time.monotonic() - started

    assert kept(lambda: asyncio.run(leaving()), 1.0)


def test_a_late_agent_sees_every_present_percept_and_keeps_up(endpoint: str, tmp_path: Path) -> None:
    async def knowing() -> float:
        async with serving(endpoint, tmp_path) as (field, first):
            names = ("altitude", "global_pos", "gps", "home_pos", "state")
            await until(lambda: all_present(first, names), "all percepts")
            async with field.client() as late:
                perceiving, behind = PerceptSync(late, "uav", "uav1", lambda one: None), list[bool]()
                started = time.monotonic()
                async with under_way(perceiving.run()):
                    await until(lambda: {one.name for one in perceiving.present()} >= set(names), "the percepts")
                    took = time.monotonic() - started
                    late.subscribe(
                        keys.health("test", "uav1", "bridged"),
                        Health,
                        lambda _key, one: behind.append(perceiving.percepts.needs_repair(one.percepts["uav"])),
                    )
                    await field.take_off(late)
                    await until(lambda: len(behind) > 2 and not behind[-1], "it keeps up")
        return took

    assert kept(lambda: asyncio.run(knowing()), 1.0)


async def test_what_is_read_together_is_one_record_and_no_status_or_health_leaves_before_the_percepts_it_refers_to(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    records, refers_to_later, last = list[Perceptions](), list[object](), 0
    put, reply, put_record = Publisher.put, Query.reply, Bus.put

    def note_percepts(publisher: Publisher, payload: bytes, encoding: str) -> None:
        nonlocal last
        if str(publisher._publisher.key_expr) == keys.percepts("test", "uav"):
            records.append(codec(Perceptions).decode(payload, encoding))
            last = records[-1].changes[-1].header.seq
        put(publisher, payload, encoding)

    def note_status(query: Query[Any], record: Any, key: str | None = None) -> None:
        if isinstance(record, ActionStatus) and (record.after or 0) > last:
            refers_to_later.append(record)
        reply(query, record, key)

    def note_health(bus: Bus, key: str, record: Any, **how: Any) -> None:
        if isinstance(record, Health) and "uav" in record.percepts and int(record.percepts["uav"].split(":")[1]) > last:
            refers_to_later.append(record)
        put_record(bus, key, record, **how)

    monkeypatch.setattr(Publisher, "put", note_percepts)
    monkeypatch.setattr(Query, "reply", note_status)
    monkeypatch.setattr(Bus, "put", note_health)
    async with serving(endpoint, tmp_path) as (field, agent):
        await field.take_off(agent)
        assert (await field.do(agent, "goto", *GOAL)).state == "succeeded"
        assert refers_to_later == []
        names = [{one.name for one in record.changes} for record in records]
        assert {"altitude", "global_pos"} in [of & {"altitude", "global_pos"} for of in names]
        changes = [one.header.seq for record in records for one in record.changes]
        assert changes == list(range(1, last + 1))


async def test_percepts_have_keys_of_their_own_only_while_somebody_subscribes(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named, put = set[str](), Bus.put

    def note(bus: Bus, key: str, record: Any, **how: Any) -> None:
        named.update([key] if "/percept/" in key else [])
        put(bus, key, record, **how)

    monkeypatch.setattr(Bus, "put", note)
    async with serving(endpoint, tmp_path) as (field, agent):
        together, alone = list[Perceptions](), list[Perception]()
        agent.subscribe(keys.percepts("test", "uav"), Perceptions, lambda _, one: together.append(one))
        assert (await field.do(agent, "set_mode", "GUIDED")).state == "succeeded"
        await until(lambda: bool(together), "the agent hears of it")
        assert not named
        agent.subscribe(keys.percept("test", "uav", "altitude"), Perception, lambda _, one: alone.append(one))
        await field.take_off(agent)
        await until(lambda: len(alone) > 1, "an observer hears one percept")
        sent = [one for record in together for one in record.changes]
        assert [one for one in sent if one in alone][:2] == alone[:2], "with the same header"


async def test_a_percept_lost_on_the_bus_is_noticed_by_the_digest_and_repaired(endpoint: str, tmp_path: Path) -> None:
    async with on_the_airfield(endpoint, tmp_path) as field, field.router(), field.client() as bus:
        copy, digests, losing = PerceptSet(), list[str](), True

        def hear(key: str, one: Perception) -> None:
            if not (losing and one.name == "state"):
                copy.apply(one)

        bus.subscribe(keys.percept("test", "uav", "**"), Perception, hear)
        bus.subscribe(
            keys.health("test", "uav1", "bridged"), Health, lambda _key, one: digests.append(one.percepts["uav"])
        )
        field.start()
        await until_served(bus)
        await until(lambda: bool(digests) and copy.needs_repair(digests[-1]), "health tells what is missing")
        assert not [one for one in copy.present() if one.name == "state"]
        losing = False

        async def repaired() -> bool:  # the vehicle may not have told its state before
            return await restored(copy, bus) and any(one.name == "state" for one in copy.present())

        await until(repaired, "its state")
        assert [one.parameters for one in copy.present() if one.name == "state"] == [("STABILIZE", True, False)]
        assert not copy.needs_repair()
        await field.leave()


async def test_a_bridge_that_stood_still_reads_what_came_before_it_calls_the_vehicle_silent() -> None:
    port, link_loss = free_port(), 1.0
    manifest = replace(COPTER, robot=replace(COPTER.robot, link_loss=Duration(link_loss)))
    async with riding(f"link: 'udpin:127.0.0.1:{port}'", manifest=manifest) as [ride]:
        vehicle = Speaker(port)
        vehicle.say(BEAT)
        await until(lambda: bool(ride.readings), "the vehicle is heard")
        for _ in range(5):
            vehicle.say(BEAT, place())
        time.sleep(link_loss + 1.5)  # a slow disk, say: the event loop gets no turn, while packets have come in

        def told() -> list[object]:
            beats = [reading.fields for reading in ride.readings if reading.source == "HEARTBEAT"]
            return [fields["connected"] for fields in beats if fields]

        await until(lambda: len(told()) > 5, "what came meanwhile is read")
        assert all(told()[:6])
        assert ride.driver.counters()["stalls"] >= 1


async def test_a_second_bridge_of_the_same_robot_refuses_to_start_and_says_which(endpoint: str, tmp_path: Path) -> None:
    async with serving(endpoint, tmp_path) as (field, _bus):
        with pytest.raises(AlreadyRunning, match="another bridged serves `uav1`"):
            await serve(field.mission, field.arguments(), asyncio.Event())


@pytest.mark.parametrize(("boot", "first_stays"), [("ffffffff", True), ("00000000", False)])
async def test_of_two_bridges_that_meet_after_a_cut_one_gives_way_without_an_order_to_the_robot(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, boot: str, first_stays: bool
) -> None:
    async with serving(endpoint, tmp_path) as (field, bus):
        await field.take_off(bus)
        far, going = await beginning(field, bus, "goto", *FAR)
        monkeypatch.setattr("bridged.bridge.two_bridges.NEAR", 1e6)
        monkeypatch.setattr("commd.bus.bus.boot_id", lambda: boot)
        monkeypatch.setattr(Bus, "claim", lambda bus, name: asyncio.to_thread(bus.token, bus._own(name)))
        second = Airfield(endpoint, tmp_path / "other")
        second.start()
        gives_way, stays = (second.daemon, field.daemon) if first_stays else (field.daemon, second.daemon)
        assert await gives_way == EXIT_FAILED
        assert not stays.done()
        assert field.vehicle.autopilot.mode.name == "GUIDED"
        if first_stays:
            far.cancel()
        else:
            status = (await far)[-1]
            assert (status.id, status.state, status.cause) == (going, "failed", "shutdown")
            field.daemon = second.daemon
            field.stop = second.stop


async def test_the_robot_of_an_agent_that_dies_after_its_bridge_restarted_returns_all_the_same(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lives: list[Presence] = []

    def watching(agents: list[str], board_of: Callable[[str], str | None]) -> Presence:
        lives.append(Presence(agents, board_of))
        return lives[-1]

    monkeypatch.setattr("bridged.bridge.agent_monitor.Presence", watching)
    async with serving(endpoint, tmp_path, client="watcher", mission=HELD_AT_THE_END) as (field, watcher):
        async with field.client() as agent:
            await agent.claim("uav")
            await field.take_off(agent)
            await field.leave()
            field.start()
            await until_served(watcher)
            await until(lambda: len(lives) == 2 and lives[-1].there() == {"uav"}, "its new life sees the agent")
        await field.mode_is("RTL")  # although the agent asked for nothing


async def test_the_robot_of_an_agent_that_died_with_its_bridge_returns_although_another_agent_is_alive(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.liveness.presence.ROUTER_GRACE", 1.0)
    async with serving(endpoint, tmp_path, client="other", mission=HELD_AT_THE_END) as (field, other):
        await other.claim("other")
        async with field.client() as agent:
            await agent.claim("uav")
            await field.take_off(agent)
            await field.leave()
        field.start()
        await field.mode_is("RTL")

        async def taken() -> bool:
            status = await field.do(other, "set_mode", "GUIDED", agent="other")
            assert status.state in ("refused", "succeeded"), status.reason
            return status.state == "succeeded"

        await until(taken, "the other agent takes it")


async def test_a_vehicle_out_of_reach_when_its_agent_dies_returns_once_it_is_heard_again(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("bridged.bridge.safety_orders.ORDER_PATIENCE", 1.0)
    async with serving(endpoint, tmp_path, client="watcher") as (field, _watcher):
        async with field.client() as agent:
            await agent.claim("uav")
            await field.take_off(agent)
            field.silent = True
        await until(lambda: "hold (agent uav is lost: hold): timed_out" in caplog.text, "the order is not heard")
        await until(lambda: "system 1 is lost: no heartbeat" in caplog.text, "nor is the vehicle")
        field.silent = False
        await field.mode_is("RTL")


@pytest.mark.parametrize("deaf", [0.0, 2.5], ids=["heard", "several HEARTBEATs are lost"])
async def test_a_vehicle_that_arms_as_the_bridge_stops_is_disarmed(deaf: float, endpoint: str, tmp_path: Path) -> None:
    async with serving(endpoint, tmp_path, speed=1.0) as (field, bus):
        assert (await field.do(bus, "set_mode", "GUIDED")).state == "succeeded"
        field.withheld.add("HEARTBEAT")
        arming = asyncio.create_task(field.ask(bus, "arm_motors", True))
        await until(lambda: field.vehicle.autopilot.armed, "armed, before a HEARTBEAT says so")
        field.stop.set()
        asyncio.get_running_loop().call_later(deaf, field.withheld.clear)
        await field.leave()
        assert not field.vehicle.autopilot.armed
        assert not (await arming)[-1].result


async def test_a_router_killed_and_back_within_3_s_does_not_fail_the_flight(endpoint: str, tmp_path: Path) -> None:
    file = tmp_path / "mission.yaml"
    (tmp_path / "uav.asl").write_text("")
    file.write_text(MISSION)
    async with on_the_airfield(endpoint, tmp_path) as field:
        router = Daemon("commd", "serve", str(file), "--router", endpoint)
        try:
            async with field.client() as bus:
                await bus.claim("uav")
                field.start()
                await until_served(bus)
                await field.take_off(bus)
                backfill, action = await beginning(field, bus, "goto", -27.6030, -48.5175, 20)
                router.kill()
                heard = await backfill
                assert not heard[-1].final, "the query ended without a final status"
                router = Daemon("commd", "serve", str(file), "--router", endpoint)
                await until(lambda: bus.router_up, "the router is back")

                async def ended() -> bool:
                    heard[:] = await field.ask(bus, "goto", id=action, attempt=2)
                    return bool(heard) and heard[-1].final

                await until(ended, "the action ends", 240)
                assert heard[-1].state == "succeeded", heard[-1].reason
                await field.leave()
        finally:
            router.kill()


async def test_a_query_that_is_no_request_is_answered_with_what_the_action_is(endpoint: str, tmp_path: Path) -> None:
    async def described(bus: Bus, name: str) -> list[ActionDescription]:
        replies = [one async for one in bus.query(keys.action("test", "uav", name), None, ActionDescription, 60)]
        return [one.record for one in replies if one.record]

    async with serving(endpoint, tmp_path) as (field, bus):
        [one] = await described(bus, "takeoff")
        assert one.signature == "takeoff(altitude: float 1..120 m)"
        assert {each.name for each in await described(bus, "*")} >= {"takeoff", "land", "goto"}
        wild = keys.action("test", "uav", "*")
        request = bus.query(wild, Cancel(id="x"), ActionDescription, 60)
        bad = [reply.record async for reply in request if reply.record]
        assert "expected a Action, got a Cancel" in bad[0].problem
        large = bus.query(keys.action("test", "uav", "land"), Action(parameters=("x" * 200_000,)), ActionStatus, 60)
        assert ["expected at most 131072" in reply.error async for reply in large] == [True]
        assert not field.vehicle.autopilot.armed


async def test_sigterm_in_flight_leaves_the_vehicle_returning_and_says_so(endpoint: str, tmp_path: Path) -> None:
    file = tmp_path / "mission.yaml"
    (tmp_path / "uav.asl").write_text("")
    file.write_text(MISSION)
    async with on_the_airfield(endpoint, tmp_path) as field, field.router(), field.client() as bus:
        options = [
            "--router",
            endpoint,
            "--speed",
            str(field.speed),
            "--link",
            field.link,
            "--state",
            str(tmp_path),
        ]
        daemon = Daemon("bridged", "serve", str(file), "uav1", *options)
        try:
            await until_served(bus)
            await field.take_off(bus)
            daemon.signal(signal.SIGTERM)
            assert await asyncio.to_thread(daemon.ends) == 0
            assert "speed 10: for simulated vehicles only" in daemon.text
            assert "leaving uav1: rtl: the vehicle is in RTL" in daemon.text
            assert field.vehicle.autopilot.mode.name == "RTL"
        finally:
            daemon.kill()


def void(_: object) -> None:
    """A handler's result that nobody wants."""
