"""A robot that two agents share, on real Zenoh: handed to one that is alive, and anybody's when that one has died."""

import asyncio
from pathlib import Path

import pytest

from commd.bus.bus import Bus
from commd.common.clock import Clock
from commd.process.process import report_health
from schemas.mission.model import THIS_MACHINE
from schemas.wire import keys
from schemas.wire.records import AgentHealth, Health
from schemas.wire.terms import Atom
from tests.bridged.airfield import present, serving, until
from tests.bridged.sky import GOAL, MISSION
from tests.support.buses import subscribed

LOST = "agent other is lost: the bridge brings the robot to safety first"


async def perceived(bus: Bus, agent: str) -> Atom | None:
    """Whom an agent perceives as the holder."""
    told = [one.record.parameters[0] for one in await present(bus, agent) if one.record and one.record.name == "holder"]
    assert all(isinstance(one, Atom) for one in told)
    return told[0] if told else None  # type: ignore[return-value]


async def test_a_robot_is_handed_to_a_live_agent_and_taken_again_when_it_dies(endpoint: str, tmp_path: Path) -> None:
    async with serving(endpoint, tmp_path) as (field, uav):
        await uav.claim("uav")
        await field.take_off(uav)
        assert await perceived(uav, "other") == Atom("uav")
        refused = await field.do(uav, "hand_over", Atom("other"))
        assert (refused.state, refused.reason) == ("refused", "hand_over: agent other is not alive")
        async with field.client("other") as other:
            await other.claim("other")

            async def handed_over() -> bool:
                return (await field.do(uav, "hand_over", Atom("other"))).state == "succeeded"

            await until(handed_over, "the robot is handed over")
            assert await perceived(uav, "uav") == Atom("other")
            assert (await field.do(uav, "land")).reason.startswith("held by other for ")
            assert (await field.do(other, "get_param", "RTL_ALT", agent="other")).state == "succeeded"
        await field.mode_is("BRAKE")
        assert (await field.do(uav, "land")).reason == LOST
        await field.mode_is("RTL")

        async def taken() -> bool:
            status = await field.do(uav, "set_mode", "GUIDED")
            assert (status.state, status.reason) == ("refused", LOST) or status.state == "succeeded"
            return status.state == "succeeded"

        await until(taken, "the agent takes the robot again")
        assert await perceived(uav, "other") == Atom("uav")


async def report_agents(bus: Bus) -> None:
    """Publish the health of an agentd that runs the agent `uav`, for ever."""
    await report_health(bus, THIS_MACHINE, Clock(), agents=lambda: {"uav": AgentHealth})


async def test_the_robot_of_an_agent_that_is_never_heard_and_acts_is_brought_to_safety_when_it_ends(
    endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commd.liveness.presence.FIRST_HEALTH", 0.0)
    mission = MISSION.replace(
        "    link:", "    agent_silence: 3s\n    on_idle: none\n    on_agent_loss: [hold 5min, rtl]\n    link:"
    )
    async with serving(endpoint, tmp_path, client="observer", mission=mission) as (field, _):
        async with field.client() as uav:  # its agentd runs on a board that this mission does not name
            await field.take_off(uav)
            await uav.claim("uav")
            await field.mode_is("BRAKE")
            assert (await field.do(uav, "set_mode", "GUIDED")).state == "succeeded"
            assert (await field.do(uav, "goto", *GOAL)).state == "succeeded"
            assert field.vehicle.autopilot.mode.name == "GUIDED"
        await field.mode_is("BRAKE")


async def test_the_robot_of_an_agent_that_hangs_is_brought_to_safety_although_its_token_stays(
    endpoint: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    mission = MISSION.replace("    link:", "    agent_silence: 3s\n    on_agent_loss: [hold 5min, rtl]\n    link:")
    async with serving(endpoint, tmp_path, mission=mission) as (field, uav):
        await uav.claim("uav")
        await subscribed(uav, keys.health("test", THIS_MACHINE, "agentd"))
        said = list[Health]()
        uav.subscribe(keys.health("test", THIS_MACHINE, "agentd"), Health, lambda _, one: said.append(one))
        speaking = asyncio.create_task(report_agents(uav))
        await field.take_off(uav)
        await until(lambda: len(said) > 4, "it speaks for longer than it may be silent")
        assert field.vehicle.autopilot.mode.name == "GUIDED", "an agent that speaks has its robot"
        speaking.cancel()
        await field.mode_is("BRAKE")
        refused = await field.do(uav, "land", agent="other")
        assert refused.reason == "agent uav is lost: the bridge brings the robot to safety first"
        speaking = asyncio.create_task(report_agents(uav))

        async def taken() -> bool:
            status = await field.do(uav, "set_mode", "GUIDED")
            assert status.state == "succeeded" or "is lost" in status.reason
            return status.state == "succeeded"

        await until(taken, "the agent takes the robot again")
        assert field.vehicle.autopilot.mode.name == "GUIDED", "the agent is back: rtl is left out"
        speaking.cancel()
    assert "agent uav is lost (it is present and has been silent for 3 s: it hangs)" in caplog.text
