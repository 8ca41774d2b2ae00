"""A robot that knows no hold, only an action that does it: when it is told to hold, and what if it is not."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from bridged.bridge import composite_driver as body_module
from bridged.bridge.bridge import Bridge
from bridged.bridge.live_manifest import RunningManifest
from bridged.bridge.robot_setup import order_findings
from bridged.bridge.safety_orders import by_operator
from bridged.drivers.api import Outcome
from bridged.drivers.registry import check_manifest
from bridged.drivers.zenoh.driver import ZenohDriver
from commd.bus.bus import Bus
from commd.common.clock import Clock
from schemas.manifest.loader import read_manifest
from schemas.mission.model import read_mission
from schemas.wire.records import Action, ActionStatus, ManifestChange
from schemas.wire.terms import Term
from tests.support.buses import session, until

MANIFEST = """
[robot]
driver = "zenoh"
[orders]
hold = "stop"
[actions.stop]
topic = "t/cmd"
fields = {v = {value = 0}}
[actions.cmd]
params = [{name = "v"}]
topic = "t/cmd"
[actions.goto]
params = [{name = "x"}]
service = "svc/goto"
cancel = "hold"
[actions.pen]
params = [{name = "on", type = "boolean"}]
service = "svc/pen"
motion = false
"""
MISSION = """
mission: m
agents:
  a: {program: a.asl, robot: r}
  b: {program: b.asl, robot: r}
robots:
  r: {manifest: x.toml, lease: {priority: [b, a]}}
"""


class Turtle:
    """A robot on a bus that takes its time for services, and its bridge."""

    def __init__(self, bridge: Bus, robot: Bus, state: Path) -> None:
        self._bus, self._state, self._ids = bridge, state, 0
        self.commands: list[bytes] = []
        self.hears = robot.raw.subscribe("t/cmd", lambda sample: self.commands.append(sample.payload))
        self._asked: list[zenoh.Query] = []  # a query ends when it is forgotten
        for key in ("svc/goto", "svc/pen"):
            robot._session.declare_queryable(key, zenoh.handlers.Callback(self._asked.append, indirect=False))
        self.begin()

    def begin(self) -> None:
        """A life of the bridge begins."""
        manifest = read_manifest(MANIFEST, "x.toml")
        assert check_manifest(manifest) == []
        mission = read_mission(MISSION, self._state / "m.yaml")
        self.bridge = Bridge(
            mission, "r", manifest, Clock(), self._state / "r.actions", lambda *_: None, lambda *_: None,
            boot="b", bus=self._bus,
        )  # fmt: skip
        self._running = asyncio.create_task(self.bridge.run())

    async def end(self) -> None:
        """The bridge is gone, without a word."""
        self._running.cancel()
        await asyncio.gather(self._running, return_exceptions=True)
        self.bridge.action_log.close()

    async def ask(self, agent: str, name: str, *parameters: Term) -> list[ActionStatus]:
        """Ask for an action and wait until it is under way; the list grows with its statuses."""
        self._ids += 1
        heard: list[ActionStatus] = []
        request = Action(id=f"{agent}:t:{self._ids}", parameters=parameters)
        self.bridge.action_server.ask(agent, name, request, lambda status: heard.append(status) if status else None)
        asked = len(self._asked)
        if name in ("goto", "pen"):
            await until(lambda: len(self._asked) > asked or heard[-1].final, f"{name} is asked")
        return heard

    @property
    def stops(self) -> int:
        """How often it was told to stop."""
        return self.commands.count(b'{"v":0}')

    def notes(self) -> dict[str, str]:
        """The texts of what health warns of, by code."""
        return {note.code: note.text for note in self.bridge.health().notes}


@pytest.fixture
@asynccontextmanager
async def turtle(endpoint: str, tmp_path: Path) -> AsyncIterator[Turtle]:
    """Yield a turtle on a bus of its own."""
    async with (
        session(endpoint, "board", "commd", router=True),
        session(endpoint, "r", "bridged") as bridge,
        session(endpoint, "robot", "robot") as robot,
    ):
        turtle = Turtle(bridge, robot, tmp_path)
        try:
            yield turtle
        finally:
            await turtle.end()


async def test_cancelling_a_motion_lets_the_robot_hold_and_what_does_not_move_it_go_on(turtle: Turtle) -> None:
    pen, going = await turtle.ask("a", "pen", True), await turtle.ask("a", "goto", 1.0)
    turtle.bridge.action_server.cancel("a", going[-1].id)
    await until(lambda: turtle.stops == 1, "it is told to stop")
    assert going[-1].state == "cancelled"
    turtle.bridge.step()
    assert not pen[-1].final
    await until(lambda: not turtle.bridge.driver.active, "it holds")
    assert turtle.notes() == {}


async def test_a_hold_that_does_not_happen_is_said_in_the_reason_and_in_health(turtle: Turtle) -> None:
    turtle.hears.close()
    going = await turtle.ask("a", "goto", 1.0)
    status = turtle.bridge.action_server.cancel("a", going[-1].id)
    assert status.reason == "cancelled by a; hold is not confirmed yet"
    await until(lambda: "may_be_moving" in turtle.notes(), "the failure is told")
    assert turtle.notes()["may_be_moving"].endswith("`stop` failed: nobody subscribes to t/cmd")
    assert turtle.bridge.driver.active, "it is not left alone"


async def test_a_hold_that_is_never_answered_is_given_up_after_its_patience(turtle: Turtle, monkeypatch: Any) -> None:
    monkeypatch.setattr(body_module, "HOLD_PATIENCE", 0.3)
    turtle.hears.close()
    going = await turtle.ask("a", "goto", 1.0)
    turtle.bridge.action_server.cancel("a", going[-1].id)
    given_up = "timed out: not done within 0.3 s"
    await until(lambda: turtle.notes().get("may_be_moving", "").endswith(given_up), "the failure is told")


async def test_a_robot_whose_motion_has_ended_holds_when_it_is_told_to_explicitly(turtle: Turtle) -> None:
    entry = turtle.bridge.live.manifest.actions["goto"]
    going = turtle.bridge.driver.perform("goto", entry, {"x": 1.0})
    turtle.bridge.driver.stop(going, Outcome("failed", "lease taken by b"), hold=False)
    turtle.bridge.driver.hold(going, "lease taken by b")
    await until(lambda: turtle.stops == 1, "it is told to stop")


async def test_a_robot_that_moved_when_its_bridge_ended_is_stopped_when_the_next_one_ends(turtle: Turtle) -> None:
    moving = await turtle.ask("a", "cmd", 1.0)
    await until(lambda: moving[-1].state == "succeeded", "it moves")
    await turtle.end()
    turtle.begin()
    assert turtle.bridge.lease.answers == "a"
    assert turtle.bridge.driver.active
    left = await turtle.bridge.orders.shut_down("rtl")
    assert (left.state, left.order) == ("ordered", "hold")
    await until(lambda: turtle.stops == 1, "it is told to stop")
    assert not turtle.bridge.driver.active


async def test_a_robot_that_knows_no_arming_is_not_called_disarmed_when_it_is_left(turtle: Turtle) -> None:
    driver = turtle.bridge.driver.own
    assert isinstance(driver, ZenohDriver)
    await until(lambda: driver.heard, "somebody listens")
    left = await turtle.bridge.orders.shut_down("rtl")
    assert (left.state, left.text) == ("disarmed", "left as it is")


async def test_the_order_that_ends_a_motion_cannot_be_taken_away_while_the_robot_may_be_moving(turtle: Turtle) -> None:
    moving = await turtle.ask("a", "cmd", 1.0)
    await until(lambda: moving[-1].state == "succeeded", "it moves")
    change = ManifestChange(remove=("orders.hold",))
    said = "orders.hold: the robot may be moving, and this order ends it; stop it first"
    assert turtle.bridge.live.change(change) == [said]
    stopped = turtle.bridge.action_server.order("hold", by_operator("hold"), block=False, insist=True)
    await until(lambda: stopped.over and not turtle.bridge.driver.active, "it holds")
    assert turtle.bridge.live.change(change) == []


def test_a_live_change_cannot_take_away_an_order_that_the_mission_relies_on(tmp_path: Path) -> None:
    text = MANIFEST.replace('driver = "zenoh"', 'driver = "python"')
    text = text[: text.index("[actions")] + '[actions.stop]\ncall = "x.stop"\n'
    mission = read_mission(MISSION.replace("lease:", "on_shutdown: hold, lease:"), tmp_path / "m.yaml")
    manifest = read_manifest(text, "x.toml")
    assert order_findings(mission, "r", manifest) == []
    running = RunningManifest(manifest, lambda manifest: None, lambda manifest: order_findings(mission, "r", manifest))
    problems = running.change(ManifestChange(remove=("orders.hold",)))
    assert any(one.startswith("on_shutdown: the robot has no order `hold`") for one in problems), problems


async def test_a_robot_that_is_taken_by_an_action_that_does_not_move_it_is_told_to_stop(turtle: Turtle) -> None:
    going = await turtle.ask("a", "goto", 1.0)
    pen = await turtle.ask("b", "pen", True)
    assert (going[-1].state, going[-1].reason) == ("failed", "lease taken by b")
    await until(lambda: turtle.stops == 1, "it is told to stop")
    assert not pen[-1].final
