"""Whole flights of real processes whose agent is killed in the air and started again."""

from pathlib import Path

from tests.bridged.drivers.mavlink.test_flights_that_go_wrong import Field, printed
from tests.support.processes import running

FLIER = """\
!fly.
+!fly <- set_mode("GUIDED"); arm_motors(true); takeoff(10); !!away.
+!away <- .print("going"); goto(-27.600, -48.515, 20); .print("arrived").
-!away[state(S), reason(R)] <- .print("away: ", S, ", ", R); set_mode("GUIDED"); !!away.
+restarted(N) <- .print("back ", N); !!away.
+interrupted(A, S, R) <- .print("interrupted ", S, ", ", R).
"""


def test_an_agent_back_immediately_joins_its_flight_and_a_late_one_gets_its_robot_back(tmp_path: Path) -> None:
    field = Field(tmp_path, FLIER, "")
    mission = tmp_path / "m.yaml"
    mission.write_text(mission.read_text() + '    on_agent_loss: ["hold 600s", rtl]\n')
    with field.router, field.copter, running(*field.bridge) as bridge:
        with running(*field.agents("uav")) as first:
            printed(first, "uav", "going")
            with running(*field.agents("uav")) as second:
                second.says("router up")  # it waits for the name by now
                first.kill()
                printed(second, "uav", "back 1")
                second.says("goes on with goto, which a former life has begun")
                bridge_said = bridge.text
                assert "is lost" not in bridge_said
                assert bridge_said.count(" goto[") == 1
                second.kill()
        bridge.until(lambda text: "agent uav is lost: hold" in text, "the copter is held")
        with running(*field.agents("uav")) as third:
            printed(third, "uav", "back 2")
            assert printed(third, "uav", "interrupted") == "interrupted failed, agent uav is lost: no liveliness token"
            printed(third, "uav", "arrived")


def test_the_robot_of_an_agent_that_an_edited_mission_has_no_more_is_brought_to_safety_by_a_restarted_bridge(
    tmp_path: Path,
) -> None:
    field = Field(tmp_path, FLIER, "!nothing. +!nothing.", failsafe=0)
    mission = Path(field.mission)
    with field.router, field.copter, running(*field.agents("uav")) as agent:
        with running(*field.bridge) as bridge:
            printed(agent, "uav", "going")
            bridge.kill()
        mission.write_text(mission.read_text().replace("  uav: {program", "  renamed: {program"))
        with running(*field.bridge) as again:
            again.says("agent uav is lost (it has not come back since the bridge restarted)")
            again.until(lambda text: "rtl (agent uav is lost: rtl): succeeded" in text, "the copter returns")


def test_the_robot_of_a_restarted_agent_that_now_has_no_robot_is_brought_to_safety(tmp_path: Path) -> None:
    field = Field(tmp_path, FLIER, "!nothing. +!nothing.", failsafe=0)
    mission = Path(field.mission)
    with field.router, field.copter, running(*field.bridge) as bridge:
        with running(*field.agents("uav")) as agent:
            printed(agent, "uav", "going")
            agent.kill()
        mission.write_text(mission.read_text().replace("uav.asl, robot: uav1", "uav.asl"))
        with running(*field.agents("uav")) as again:
            printed(again, "uav", "back 1")
            bridge.says("agent uav is lost (by the mission that its agentd has read it commands no robot)")
            bridge.until(lambda text: "rtl (agent uav is lost: rtl): succeeded" in text, "the copter returns")
