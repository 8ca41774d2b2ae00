"""When the agents of a robot count as idle, and when as lost."""

import asyncio
from functools import partial
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import Mock

import pytest

from bridged.bridge.agent_monitor import Idleness, watch_agents
from schemas.liveness import ROUTER_GRACE
from schemas.wire import keys
from schemas.wire.records import AgentHealth, Health
from tests.bridged.sky import VirtualClock


def idle_for(idleness: Idleness, there: set[str], *, seconds: float, speed: float = 1.0) -> float:
    """Let mission time pass in which nobody has the robot."""
    result, start, at = 0.0, 1000.0, 0.0
    while at <= seconds:
        result = idleness.look(there, True, start + at, (start + at) / speed)
        at += 0.5
    return result


def told(**agents: bool | None) -> Idleness:
    idleness = Idleness(10.0)
    for agent, idle in agents.items():
        idleness.told(agent, idle)
    return idleness


def test_an_agent_counts_as_idle_after_the_time_that_the_mission_says() -> None:
    assert idle_for(told(uav=True), {"uav"}, seconds=9.5) == 0
    assert idle_for(told(uav=True), {"uav"}, seconds=10) == 10


def test_one_agent_with_an_intention_or_that_does_not_say_is_enough() -> None:
    assert idle_for(told(uav=True, wing=False), {"uav", "wing"}, seconds=60) == 0
    assert idle_for(told(uav=True), {"uav", "planner"}, seconds=60) == 0
    assert idle_for(told(uav=None), {"uav"}, seconds=60) == 0
    assert idle_for(told(uav=True), {"uav"}, seconds=60) == 60, "of agents that are there"
    assert idle_for(told(uav=True), set(), seconds=60) == 0, "who is not there is lost, and not idle"


def test_a_robot_whose_agent_is_lost_is_nobodys_whatever_the_others_intend() -> None:
    idleness = told(wing=False)
    assert idleness.look({"wing"}, True, 0, 0, lost=True) == 0
    assert idleness.look({"wing"}, True, 10, 10, lost=True) == 10
    assert idleness.look(set(), True, 11, 11, lost=True) == 11
    assert idleness.look(set(), False, 12, 12, lost=True) == 0, "the operator, a pilot or a sequence has it"


def test_time_begins_again_whenever_somebody_has_had_the_robot() -> None:
    idleness = told(uav=True)
    assert idleness.look({"uav"}, True, 0, 0) == 0
    assert idleness.look({"uav"}, False, 8, 8) == 0
    assert idleness.look({"uav"}, True, 9, 9) == 0
    assert idleness.look({"uav"}, True, 18, 18) == 0
    assert idleness.look({"uav"}, True, 19, 19) == 10


def test_what_a_former_life_said_does_not_count() -> None:
    idleness = told(uav=True)
    idleness.gone("uav")
    assert idle_for(idleness, {"uav"}, seconds=60) == 0


def test_at_high_speed_an_agent_has_the_wall_time_to_say_that_it_is_not_idle() -> None:
    assert idle_for(told(uav=True), {"uav"}, seconds=140, speed=50) == 0
    assert idle_for(told(uav=True), {"uav"}, seconds=160, speed=50) == 160


class Watching:
    """`watch_agents` of the robot `uav1` with the agent `uav`, on a bus that is not there."""

    def __init__(self, answers: str, *, inherited: bool = True) -> None:
        self.handlers: dict[str, Any] = {}
        bus = SimpleNamespace(
            fleet="f",
            on_router=partial(self.handlers.__setitem__, "router"),
            watch=self.handlers.__setitem__,
            subscribe=lambda key, _, word: self.handlers.update({key: word}),
        )
        robot = SimpleNamespace(agent_silence=5.0, idle_after=10.0)
        mission = SimpleNamespace(robots={"uav1": robot}, mailboxes={"uav": "pi1"}, boards={})
        part = SimpleNamespace(name="uav1", agents=("uav",), steps=(), idle_steps=())
        self.lease = SimpleNamespace(answers=answers, inherited=inherited, present=None)
        self.orders = Mock(unattended=False, lost_agent=answers)
        bridge = SimpleNamespace(lease=self.lease, orders=self.orders, driver=Mock(active=True))
        self.clock = VirtualClock()
        self.task = asyncio.create_task(watch_agents(*cast(Any, (bus, mission, part, bridge)), self.clock))

    async def hear(self, handler: str, *told: object) -> None:
        """Call a handler, and let the monitor look."""
        await asyncio.sleep(0)
        self.handlers[handler](*told)
        for _ in range(10):
            await asyncio.sleep(0)

    async def look(self, at: float) -> None:
        """Let the monitor look at a time in seconds."""
        self.clock.time = at
        await self.hear("router", True)


async def test_an_agent_that_commands_another_robot_is_not_back_because_its_daemon_ends() -> None:
    watching = Watching("uav")
    token, health = keys.alive("f", "uav", "agentd", "b1"), keys.health("f", "pi1", "agentd")
    await watching.hear(keys.alive("f", "uav", "*", "*"), token, True)
    await watching.hear(health, health, Health(agents={"uav": AgentHealth(robot="uav2")}))
    watching.orders.agent_lost.assert_called_once()
    await watching.hear(keys.alive("f", "uav", "*", "*"), token, False)
    watching.orders.agent_back.assert_not_called()
    watching.task.cancel()


@pytest.mark.parametrize("inherited", [True, False])
async def test_an_agent_that_answers_for_a_robot_found_in_use_must_appear_and_one_in_whose_name_somebody_acts_not(
    inherited: bool,
) -> None:
    watching = Watching("", inherited=True)
    await watching.look(60.0)
    watching.lease.answers, watching.lease.inherited = "uav", inherited
    await watching.look(61.0)
    await watching.look(61.0 + ROUTER_GRACE - 0.1)
    watching.orders.agent_lost.assert_not_called()
    await watching.look(61.0 + ROUTER_GRACE)
    assert watching.orders.agent_lost.called is inherited
    watching.task.cancel()
