"""A copter that is simulated on the ground, and flown by an agent and a bridge on boards."""

from collections.abc import Callable

from tests.boards.fleet import Fleet
from tests.support.processes import ROOT

_MISSION = """\
mission: over-the-field
speed: 10
boards: BOARDS
agents:
  uav:
    board: pi1
    program: uav.asl
    robot: uav1
    beliefs: ["takeoff_altitude(5)", "waypoint(-27.603683, -48.518052, 40)"]
  tower: {board: pi3, program: tower.asl}
robots:
  uav1:
    board: pi2
    manifest: copter
    link: udpin:0.0.0.0:14550
    simulate: {board: ground, home: [-27.604033, -48.518363, 21.0]}
"""
_FLIER = (ROOT / "missions" / "single_uav" / "uav.asl").read_text()
_REPORTS = "+mission_done <- .send(tower, tell, landed).\n"


def test_a_copter_simulated_on_the_ground_is_flown_by_the_agent_of_another_board(fleet: Callable[..., Fleet]) -> None:
    team = fleet(_MISSION, uav=_FLIER + _REPORTS, tower="")
    team.ground("argosy", "simulate", str(team.path), "--board", "ground").says("simulated copter")
    team.up()
    team.look("pi3").believes("tower", "landed[source(uav)]", 150)
    assert "mission failed" not in team.text("pi1", "agentd")
