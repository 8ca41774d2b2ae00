"""What `argosy run` tells of a run: who left with it is no loss, what was known last stands, its mission counts."""

from pathlib import Path

import pytest

from argosy.fleet_model.activity import activity
from schemas.mission.model import Mission, read_mission
from schemas.wire import keys
from schemas.wire.records import RunningMission
from tests.argosy.fleet_model.fleet import FLEET, Fleet, rescue

TEXT = """
mission: {name}
fleet: sar
agents: {{scout: {{program: scout.asl, robot: uav1}}{more}}}
robots: {{uav1: {{manifest: copter, link: "udpin:127.0.0.1:14550", limits: {{radius: 500}}}}}}
timeout: 9min
speed: 2
"""


def mission(name: str, more: str = "") -> Mission:
    return read_mission(TEXT.format(name=name, more=more), Path(f"{name}.yaml"))


def flown(phase: str = "done", **fields: object) -> Fleet:
    """A scout that was flown by `argosy run` to its end, after which everybody has left and the router, too."""
    fleet = (
        rescue().runs("running", 10.0).waits(1).percept("scout", "state", "RTL", True, False).told("uav1", "bridged")
    )
    fleet.runs(phase, 11.5, **fields).waits(0.5)  # type: ignore[arg-type]
    fleet.goes("scout", "agentd").goes("uav1", "bridged").waits(2)
    fleet.model.router(up=False)
    return fleet.waits(600)


def test_who_leaves_when_the_run_is_done_is_no_loss_and_what_was_known_last_does_not_get_old() -> None:
    model = flown(report="/r").model
    scout, uav1 = model.agents["scout"], model.robots["uav1"]
    assert (scout.there, scout.ended, uav1.ended, scout.notes, uav1.notes) == (False, True, True, (), ())
    assert not uav1.stale(model.as_of)
    assert model.over
    assert model.run_silent is None
    assert [entry.level for entry in model.timeline.entries if entry.level in ("warning", "error")] == []
    assert "the mission is done" in [entry.text for entry in model.timeline.entries]


def test_who_has_died_is_lost_also_when_the_run_ends_because_of_it() -> None:
    fleet = rescue().runs("running", 10.0).waits(1)
    fleet.runs("bringing_home", 11.0, why="agentd scout was killed by SIGKILL", dead=("agentd scout",))
    fleet.goes("scout", "agentd").waits(2).goes("uav1", "bridged").waits(2)
    fleet.runs("failed", 15.0, why="agentd scout was killed by SIGKILL", dead=("agentd scout",))
    assert not fleet.model.agents["scout"].ended
    assert fleet.model.robots["uav1"].ended


def test_a_robot_of_which_nothing_was_heard_when_its_run_ended_is_old() -> None:
    fleet = rescue().runs("running", 10.0).waits(60).runs("failed", 70.0)
    assert fleet.model.robots["uav1"].stale(fleet.model.as_of)


def test_another_run_begins_with_nothing_of_the_one_that_is_over() -> None:
    fleet = flown()
    fleet.model.router(up=True)
    for name, daemon in (("pi1", "commd"), ("uav1", "bridged"), ("scout", "agentd")):
        fleet.model.token(keys.alive(FLEET, name, daemon, "b1"), alive=False)
        fleet.comes(name, daemon, "b2")
    fleet.waits(10)
    assert fleet.model.run_state is None
    assert not fleet.model.over
    assert not fleet.model.agents["scout"].ended
    fleet.runs("starting", 1.0)
    assert fleet.model.clock.seconds(fleet.at) == 1.0


def test_a_run_that_nobody_watches_over_any_more_is_said_to_be() -> None:
    fleet = rescue().runs("running", 10.0).waits(4)
    assert fleet.model.run_silent is None
    assert fleet.waits(8).model.run_silent == 12.0


def test_the_clock_stands_for_nobody_and_goes_on_by_the_run_when_an_agent_is_restarted() -> None:
    fleet = rescue().runs("running", 30.0).mind("scout", time=20.0).waits(2)
    fleet.goes("scout", "agentd").comes("scout", "agentd", "b2").mind("scout", time=0.5).waits(2)
    assert fleet.model.clock.seconds(fleet.at) == 34.0


@pytest.mark.parametrize(("altitude", "doing"), [(20.0, ("flying", "goto(1,2,20)")), (0.1, ("acting", "goto(1,2,20)"))])
def test_an_agent_whose_intention_waits_for_an_action_does_that_action(altitude: float, doing: tuple[str, str]) -> None:
    fleet = rescue().mind("scout", "+!lane", state="waiting").percept("scout", "altitude", altitude)
    model, scout = fleet.model, fleet.model.agents["scout"]
    assert activity(model, scout).doing == "waiting"
    fleet.action("scout", 1, "goto", "running", 1, 2, 20)
    does = activity(model, scout)
    assert (does.doing, does.action) == doing
    assert activity(fleet.waits(5).model, scout).doing == "waiting", "nobody tells of it any more"
    fleet.action("scout", 1, "goto", "succeeded", 1, 2, 20).mind("scout", state="waiting")
    assert activity(model, scout).doing == "idle"


def test_the_mission_that_the_fleet_runs_counts_and_not_the_one_that_the_observer_was_started_with() -> None:
    fleet = Fleet(mission("theirs", ", ghost: {program: scout.asl}")).comes("local", "commd").comes("scout", "agentd")
    assert "ghost" in fleet.waits(1).model.agents
    ours = mission("ours")
    fleet.model.mission_published(keys.mission(FLEET, "local"), RunningMission(file="ours.yaml", text=ours.text))
    model = fleet.waits(1).model
    assert (model.mission.name, model.mission.timeout, list(model.agents)) == ("ours", 540.0, ["scout"])
    assert model.robots["uav1"].agents == ("scout",)
    assert model.agents["scout"].there


def test_a_mission_that_cannot_be_read_here_is_said_to_be_and_changes_nothing() -> None:
    fleet = Fleet(mission("ours")).comes("local", "commd")
    fleet.model.mission_published(
        keys.mission(FLEET, "local"), RunningMission(file="x.yaml", text="mission: 1\nnew: 2\n")
    )
    assert fleet.model.mission_problem.startswith("the mission of the fleet cannot be read here: ")
    assert fleet.model.mission.name == "ours"
