"""An agent's percepts over a real bus: late, restarted, lost on the way, and without a bridge."""

import asyncio
import time
from contextlib import AsyncExitStack
from typing import Any

import pytest
from msgspec.structs import replace

from commd.bus.bus import Bus, Query
from commd.client.percept_sync import FOLLOWS, PerceptSync
from commd.liveness.bridge_presence import BridgePresence
from schemas.wire import keys
from schemas.wire.percept_set import PerceptSet
from schemas.wire.records import Header, Health, Perception, Perceptions
from tests.support.buses import FLEET, Connect, on_a_bus, session, subscribed, under_way, until
from tests.support.promises import kept


class FakeBridge:
    """The bus side of a bridge: a present set that it tells, answers for, and reports the digest of."""

    def __init__(self, bus: Bus) -> None:
        self.bus, self.percepts, self.asked = bus, PerceptSet(), 0
        bus.serve(keys.percept(FLEET, "uav", "**"), Perception, self._answer)

    def tell(self, name: str, *parameters: Any, lose: bool = False, **how: Any) -> None:
        perception = Perception(header=self.bus.header("percept"), name=name, parameters=parameters, **how)
        self.percepts.apply(perception)
        if not lose:
            self.bus.put(keys.percepts(FLEET, "uav"), Perceptions(changes=(perception,)))

    def tell_together(self, *percepts: tuple[str, Any], lose: bool = False) -> None:
        """Tell several in one record."""
        changes = [
            Perception(header=self.bus.header("percept"), name=name, parameters=(value,)) for name, value in percepts
        ]
        for perception in changes:
            self.percepts.apply(perception)
        if not lose:
            self.bus.put(keys.percepts(FLEET, "uav"), Perceptions(changes=tuple(changes)))

    def now(self, name: str) -> tuple[Any, ...]:
        """What holds by that name."""
        return next(one.parameters for one in self.percepts.present() if one.name == name)

    def report(self) -> None:
        digest = {"uav": self.percepts.digest()}
        self.bus.put(keys.health(FLEET, "uav1", "bridged"), Health(daemon="bridged", percepts=digest))

    async def report_for_ever(self) -> None:
        """Report as often as a bridge does: what is declared late after a router's return shows by the digest."""
        while True:
            self.report()
            await asyncio.sleep(1.0)

    async def _answer(self, query: Query[Perception]) -> None:
        self.asked += 1
        for index, perception in enumerate(self.percepts.snapshot()):
            query.reply(perception, keys.percept(FLEET, "uav", f"{perception.name}/{index}"))


Changes = list[tuple[str, str, Any]]
"""Of percepts: came or gone, name, parameters."""


def perceive(bus: Bus) -> tuple[PerceptSync, Changes]:
    """Return an agent's percepts and the list to which every change is added."""
    heard: Changes = []

    def hear(one: Perception) -> None:
        heard.append(("gone" if one.update == "remove" else "came", one.name, one.parameters))

    perceiving = PerceptSync(bus, "uav", "uav1", hear)
    asyncio.get_running_loop().create_task(perceiving.run())
    return perceiving, heard


async def watched(connect: Connect, *told: tuple[str, Any]) -> tuple[FakeBridge, PerceptSync, Changes]:
    """Return a bridge that has told some percepts, an agent's percepts that hold them, and what it has heard."""
    bridge = FakeBridge(await connect("uav1", "bridged"))
    perceiving, heard = perceive(await connect("uav"))
    for name, value in told:
        bridge.tell(name, value)
    await until(lambda: len(heard) == len(told), "what was told arrives")
    await until(lambda: perceiving.counters["repairs"] == 1, "what it asked at its start is answered")
    return bridge, perceiving, heard


def forge(person: Bus, perception: Perception) -> None:
    """Put a percept in the bridge's name."""
    person.put(keys.percepts(FLEET, "uav"), Perceptions(changes=(perception,)))


def test_a_late_agent_sees_every_present_percept_within_a_second(endpoint: str) -> None:
    async def body(connect: Connect) -> None:
        bridge = FakeBridge(await connect("uav1", "bridged"))
        for index in range(20):
            bridge.tell(f"sensor{index}", index)
        bus = await connect("uav")
        started = time.monotonic()
        _, heard = perceive(bus)
        await until(lambda: len(heard) == 20, "the late agent knows all 20 percepts")
        took.append(time.monotonic() - started)

    def knowing() -> float:
        on_a_bus(endpoint, body)
        return took[-1]

    took: list[float] = []
    assert kept(knowing, 1.0)


async def test_a_percept_lost_on_the_bus_is_repaired_by_the_gap_in_seq(connect: Connect) -> None:
    bridge, _, heard = await watched(connect, ("altitude", 1))
    bridge.tell("armed", True, lose=True)
    bridge.tell("altitude", 2)
    await until(lambda: ("came", "armed", (True,)) in heard, "the lost percept is repaired")
    assert [change[2] for change in heard if change[1] == "armed"] == [(True,)]


async def test_the_bridge_of_another_robot_that_still_serves_the_agent_is_not_believed(connect: Connect) -> None:
    for robot, altitude in (("uav2", 99), ("uav1", 1)):
        FakeBridge(await connect(robot, "bridged")).tell("altitude", altitude, lose=True)
    perceiving, heard = perceive(await connect("uav"))
    await until(lambda: bool(heard), "the percepts are fetched")
    assert (heard, perceiving.counters["repairs"]) == ([("came", "altitude", (1,))], 1)


async def test_changes_that_travel_together_are_taken_in_order_and_lost_together(connect: Connect) -> None:
    bridge, _, heard = await watched(connect)
    bridge.tell_together(("altitude", 1), ("heading", 90))
    bridge.tell_together(("altitude", 2), ("heading", 91), lose=True)
    bridge.tell_together(("altitude", 3))
    await until(lambda: ("came", "heading", (91,)) in heard, "what was lost is repaired")
    assert heard[:3] == [("came", "altitude", (1,)), ("came", "heading", (90,)), ("came", "altitude", (3,))]
    assert len(heard) == 5, "the heading before it goes"


async def test_a_lost_last_percept_is_repaired_by_the_digest_in_the_bridges_health(connect: Connect) -> None:
    bridge, perceiving, heard = await watched(connect, ("altitude", 1))
    bridge.report()
    bridge.tell("altitude", 2, lose=True)
    bridge.report()
    await until(lambda: ("came", "altitude", (2,)) in heard, "the digest shows what was lost")
    assert ("gone", "altitude", (1,)) in heard
    assert perceiving.counters["repairs"] == 2


async def test_health_that_overtakes_a_percept_makes_nobody_fetch_the_set(connect: Connect) -> None:
    bridge, perceiving, heard = await watched(connect, ("altitude", 1))
    bridge.tell("altitude", 2, lose=True)
    bridge.report()
    await until(lambda: bool(perceiving._waiting), "the digest is ahead")
    bridge.bus.put(keys.percepts(FLEET, "uav"), Perceptions(changes=tuple(bridge.percepts.named("altitude"))))
    await until(lambda: ("came", "altitude", (2,)) in heard, "the percept follows")
    bridge.report()
    await asyncio.sleep(FOLLOWS + 0.2)
    assert (perceiving.counters["repairs"], perceiving.counters["late"]) == (1, 0)


async def test_a_percept_in_the_bridges_name_blinds_nobody(connect: Connect, caplog: pytest.LogCaptureFixture) -> None:
    """Somebody edits what a query has told and puts it: the bridge's own words must not be older than that for ever."""
    bridge, perceiving, heard = await watched(connect, ("altitude", 1))
    person = await connect("operator")
    [told] = bridge.percepts.snapshot()
    for ahead in (10**9, 1):
        header = replace(told.header, seq=bridge.percepts.seq + ahead)
        forge(person, replace(told, header=header, parameters=(99,)))
        await until(lambda: ("came", "altitude", (99,)) in heard, "it is believed")
        health = asyncio.create_task(bridge.report_for_ever())
        await until(lambda: heard[-1] == ("came", "altitude", bridge.now("altitude")), "the bridge is asked")
        health.cancel()
        heard.clear()
        bridge.tell("altitude", ahead)
        await until(lambda: heard == [("came", "altitude", bridge.now("altitude"))], "it is heard")
        assert bridge.now("altitude") == (ahead,)
    assert perceiving.counters["not_of_the_bridge"] == 2
    assert perceiving.percepts.seq == bridge.percepts.seq
    assert (
        "a percept in the name of uav1 was not of its bridge: its bridge is at seq 1, this set was at 1000000001"
        in (caplog.text)
    )


async def test_after_a_forged_percept_a_bridge_that_tells_nothing_is_believed(connect: Connect) -> None:
    bridge, perceiving, heard = await watched(connect)
    person = await connect("operator")
    bridge.tell("link", "up")
    bridge.tell("link", "up", update="remove", key=(0,))
    await until(lambda: len(heard) == 2, "nothing is perceived")
    header = replace(bridge.bus.header("other"), seq=500)
    flood = Perception(header=header, name="flood")
    forge(person, flood)
    await until(lambda: heard[-1] == ("came", "flood", ()), "it is believed")
    bridge.report()
    await until(lambda: heard[-1] == ("gone", "flood", ()), "it is believed no more")
    assert perceiving.percepts.seq == 2
    bridge.tell("link", "up")
    await until(lambda: heard[-1] == ("came", "link", ("up",)), "the bridge is heard")


async def test_a_percept_of_no_life_of_a_bridge_is_undone(connect: Connect, caplog: pytest.LogCaptureFixture) -> None:
    bridge, perceiving, heard = await watched(connect, ("altitude", 1))
    person = await connect("operator")
    odd = Perception(header=Header(source="uav1", boot="zz", seq=5), name="victim", parameters=(1,))
    forge(person, odd)
    await until(lambda: ("gone", "victim", (1,)) in heard, "the bridge is asked, and knows of none")
    assert perceiving.counters["not_of_the_bridge"] == 1
    bridge.tell("altitude", 2)
    await until(lambda: ("came", "altitude", (2,)) in heard, "the bridge is heard")
    assert "was not of its bridge: its bridge still runs as boot " in caplog.text


async def test_percepts_that_are_added_without_end_fill_no_memory(
    connect: Connect, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    bridge, perceiving, heard = await watched(connect)
    bridge.percepts = PerceptSet()
    monkeypatch.setattr("schemas.wire.percept_set.MOST_BYTES", 50_000)
    for number in range(100):
        bridge.tell("victim", number, update="add")
    await until(lambda: perceiving.percepts.seq == 100, "all arrive")
    there = len(perceiving.percepts)
    assert 20 < there < 40
    assert len(heard) == there
    assert perceiving.counters["left_out"] == 100 - there
    bridge.report()
    bridge.tell("victim", 0, update="remove", key=(0,))
    bridge.tell("altitude", 7)
    await until(lambda: heard[-1] == ("came", "altitude", (7,)), "there is room again")
    assert perceiving.counters["repairs"] <= 1
    assert "a percept victim is left out: those of uav1 take " in caplog.text


async def test_an_old_percept_in_the_bridges_name_is_counted_and_told(
    connect: Connect, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.client.percept_sync.IN_FLIGHT", 0.0)
    bridge, perceiving, heard = await watched(connect)
    person = await connect("operator")
    for height in range(3):
        bridge.tell("altitude", height)
    await until(lambda: len(heard) == 3, "all arrive")
    [told] = bridge.percepts.snapshot()
    header = replace(told.header, seq=2)
    old = replace(told, header=header, name="victim")
    forge(person, old)
    await until(lambda: perceiving.counters["stale"] == 1, "it is counted")
    for key in ((-1,), (1,), (0, 0)):
        forge(person, replace(told, header=replace(told.header, seq=4), key=key))
    await until(lambda: perceiving.counters["unreadable"] == 3, "keys of no parameter are counted")
    assert len(heard) == 3
    assert "a percept victim changes nothing: its header has source uav1 and seq 2, after seq 3" in caplog.text


async def test_equal_digests_ask_for_nothing(connect: Connect) -> None:
    bridge = FakeBridge(await connect("uav1", "bridged"))
    bridge.tell("altitude", 1)
    perceiving, heard = perceive(await connect("uav"))
    await until(lambda: perceiving.counters["repairs"] == 1, "what it asked at its start is answered")
    asked = bridge.asked
    for _ in range(5):
        bridge.report()
    bridge.tell("altitude", 2)
    await until(lambda: len(heard) == 2, "the next percept arrives")
    assert bridge.asked == asked
    assert heard[-1] == ("came", "altitude", (2,))


async def test_a_removed_percept_is_told_once_and_events_are_all_told(connect: Connect) -> None:
    bridge, _, heard = await watched(connect)
    bridge.tell("link", "up")
    for index in range(30):
        bridge.tell("hit", index, update="add")
    bridge.tell("link", "up", update="remove", key=(0,))
    await until(lambda: len(heard) == 32, "every change arrives")
    assert [change[2][0] for change in heard if change[1] == "hit"] == list(range(30))
    assert heard[-1] == ("gone", "link", ("up",))


async def test_when_the_bridge_dies_its_percepts_go_and_a_new_life_brings_them_back(connect: Connect) -> None:
    first_bus = await connect("uav1", "bridged")
    bridge = FakeBridge(first_bus)
    await first_bus.claim("uav1")
    bus = await connect("uav")
    perceiving, heard = perceive(bus)
    changes: list[str] = []

    def gone() -> None:
        changes.append("gone")
        perceiving.forget()

    watch = BridgePresence(bus, "uav1", lambda: (changes.append("up"), perceiving.doubt())[0], gone)
    bridge.tell("altitude", 1)
    await until(lambda: len(heard) == 1 and watch.up, "the bridge is there and tells")
    await first_bus.close()
    await until(lambda: watch.gone, "the bridge counts as dead")
    assert heard[-1] == ("gone", "altitude", (1,))
    assert len(perceiving.percepts) == 0
    second_bus = await connect("uav1", "bridged")
    again = FakeBridge(second_bus)
    again.tell("altitude", 7)
    await second_bus.claim("uav1")
    await until(lambda: heard[-1] == ("came", "altitude", (7,)), "the new life's percepts arrive")
    await until(lambda: len(changes) == 3, "the new life's token arrives, which may be after what it tells")
    assert changes == ["up", "gone", "up"]


async def test_no_percept_expires_while_nothing_changes(connect: Connect) -> None:
    bridge = FakeBridge(await connect("uav1", "bridged"))
    bridge.tell("home", 1, 2)
    agent, reports = await connect("uav"), list[Health]()
    perceiving, heard = perceive(agent)
    await until(lambda: len(heard) == 1, "the percept arrives")
    agent.subscribe(keys.health(FLEET, "uav1", "bridged"), Health, lambda _, report: reports.append(report))
    await subscribed(bridge.bus, keys.health(FLEET, "uav1", "bridged"))
    for _ in range(20):
        bridge.report()
    await until(lambda: len(reports) == 20, "the agent has all reports")
    assert heard == [("came", "home", (1, 2))]
    assert len(perceiving.percepts) == 1


async def test_without_a_router_for_long_what_the_bridge_told_is_believed_no_more(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for grace in ("ROUTER_GRACE", "BUS_GRACE"):
        monkeypatch.setattr(f"commd.liveness.presence.{grace}", 1.0)
    async with AsyncExitStack() as router:
        await router.enter_async_context(session(endpoint, "board", "commd", router=True))
        async with session(endpoint, "uav1", "bridged") as ours, session(endpoint, "uav") as agent:
            bridge = FakeBridge(ours)
            bridge.tell("altitude", 5)
            await ours.claim("uav1")
            perceiving, heard = perceive(agent)
            watch = BridgePresence(agent, "uav1", perceiving.doubt, perceiving.forget)
            async with under_way(bridge.report_for_ever()):
                await until(lambda: watch.up and len(heard) == 1, "the percept is there")
                await router.aclose()
                await until(lambda: watch.gone and heard[-1] == ("gone", "altitude", (5,)), "what may be wrong is gone")
                async with session(endpoint, "board", "commd", router=True):
                    back = ("came", "altitude", (5,))
                    await until(lambda: watch.up and heard[-1] == back, "all is back with the router")


async def test_one_percept_that_cannot_be_read_does_not_hide_the_others(connect: Connect) -> None:
    bridge = FakeBridge(await connect("uav1", "bridged"))
    bridge.tell("altitude", float("inf"))  # goes out as null: no term
    bridge.tell("mode", "GUIDED")
    perceiving, heard = perceive(await connect("uav"))
    await until(lambda: ("came", "mode", ("GUIDED",)) in heard, "what can be read is perceived")
    assert perceiving.counters["unreadable"] >= 1
