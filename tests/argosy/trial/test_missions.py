"""Shipped missions in virtual time, and what becomes of their vehicles when daemons are killed and started again.

Real kills of real daemons: tests/argosy/run/test_mission_runner.py, tests/field, tests/boards.
"""

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest

from argosy.trial.faults import Kill
from argosy.trial.single_run import Outcome
from tests.argosy.trial.conftest import MISSIONS, Fly

KILLED = "was killed by SIGKILL; it is started again"
At: TypeAlias = Callable[[str, str], float]


@pytest.fixture
def at(undisturbed: Callable[[str], Outcome]) -> At:
    """Return a function that finds when a mission without faults prints a text, in virtual seconds."""
    return lambda mission, text: float(next(one for one in undisturbed(mission).journal if text in one).split()[0])


def with_program(mission: str, program: str, folder: Path) -> str:
    """Copy a mission of one agent and give it another program. Returns its path without the suffix."""
    shutil.copytree(MISSIONS / mission, folder / mission)
    shutil.copy(MISSIONS / f"{mission}.yaml", folder)
    (folder / mission / "uav.asl").write_text(program)
    return str(folder / mission)


def modes(outcome: Outcome, after: str) -> list[str]:
    """Return the modes of uav1 after a line."""
    return re.findall(r"uav1: mode (\w+)", "\n".join(outcome.journal).partition(after)[2])


def test_each_vehicle_of_a_shared_link_is_judged_by_its_own_state(undisturbed: Callable[[str], Outcome]) -> None:
    outcome = undisturbed("three_uavs")
    assert outcome.success, outcome.why
    assert outcome.nearest is not None, "of three vehicles"


def test_the_paper_flies(undisturbed: Callable[[str], Outcome]) -> None:
    outcome = undisturbed("paper_uav")
    assert outcome.success, outcome.why
    for action in ('set_mode("GUIDED")', "arm_motors(True)", "takeoff(5)", "setpoint(-27.603683,-48.518052,61)"):
        assert any(f"uav: {action} succeeded after" in line for line in outcome.journal), action


def test_three_kinds_of_vehicles_hand_a_task_over(fly: Fly) -> None:
    outcome = fly("relay", 1)
    assert outcome.success, outcome.why
    assert outcome.violations == []
    said = ("plane: hands the task over to copter", "copter: hands the task over to rover", "rover: the task is done")
    assert [one for line in outcome.journal for one in said if one in line] == list(said)


def test_a_mission_is_done_by_what_a_robot_reports_when_its_program_never_says_so(fly: Fly, tmp_path: Path) -> None:
    silent = """\
!start.
+!start : takeoff_altitude(Alt)
  <- .wait(state(_,"True",_)); set_mode("GUIDED"); arm_motors(True); takeoff(Alt);
     .wait(altitude(A) & A > Alt - 0.5); set_mode("RTL").
"""
    mission = Path(with_program("paper_uav", silent, tmp_path)).with_suffix(".yaml")
    text = mission.read_text().replace('"uav: mission_done"', """'uav: state("RTL", _, "False")'""")
    mission.write_text(text.replace('failed: "uav: mission_failed(_)"\n', ""))
    outcome = fly(str(mission.with_suffix("")), 1)
    assert outcome.success, outcome.why


@pytest.mark.parametrize(
    ("mission", "when", "daemon"),
    [
        ("single_uav", "uav: taking off", "agentd"),
        ("single_uav", "uav: flying to", "agentd"),
        ("single_uav", "uav: returning to home", "agentd"),
        ("single_uav", "uav: flying to", "bridged:uav1"),
        ("single_uav", "uav: flying to", "commd"),
        ("three_uavs", "uav_a: hopping", "agentd"),
        ("turtle", "artist: to 8, 8", "agentd"),
        ("paper_turtle", "walker: cmd_vel(1.5", "agentd"),
    ],
)
def test_a_shipped_mission_is_done_though_a_daemon_dies(fly: Fly, at: At, mission: str, when: str, daemon: str) -> None:
    outcome = fly(mission, 1, Kill(at=at(mission, when) + 0.05, daemon=daemon))
    assert any(KILLED in line for line in outcome.journal)
    assert outcome.success, outcome.why


def test_a_program_without_a_plan_for_its_restart_fails_its_mission_on_the_ground(fly: Fly, at: At) -> None:
    outcome = fly("paper_uav", 1, Kill(at=at("paper_uav", "uav: returning to home") + 0.05, daemon="agentd"))
    assert outcome.why.startswith("uav believes mission_failed"), outcome.why
    assert not outcome.violations
    assert any(line.endswith("uav1: disarmed") for line in outcome.journal)


@pytest.mark.parametrize(
    ("when", "commanded"), [("uav1: mode RTL", False), ("uav: taking off", True), ("uav: flying to", True)]
)
def test_a_copter_whose_agent_is_back_and_does_nothing_comes_home_once(
    fly: Fly, at: At, tmp_path: Path, when: str, commanded: bool
) -> None:
    program = (MISSIONS / "single_uav" / "uav.asl").read_text()
    kept = [line for line in program.splitlines() if not line.startswith("+restarted")]
    mission = with_program("single_uav", "\n".join(kept), tmp_path)
    outcome = fly(mission, 1, Kill(at=at("single_uav", when) + 0.05, daemon="agentd"))
    assert not outcome.violations
    assert any(line.endswith("uav1: disarmed") for line in outcome.journal)
    assert ("RTL" in modes(outcome, KILLED)) is commanded, "on its way home it is not held up"


def test_a_vehicle_whose_agent_has_nothing_to_do_is_brought_home_and_the_run_fails(fly: Fly, tmp_path: Path) -> None:
    up = '!up. +!up <- .wait(bridge(up)); set_mode("GUIDED"); arm_motors(true); takeoff(5).'
    outcome = fly(with_program("single_uav", up, tmp_path), 1)
    assert any("in the air with nobody in charge: agent uav is there" in line for line in outcome.journal)
    assert modes(outcome, "takeoff(5) succeeded") == ["RTL"]
    why = "uav1 was in the air without an agent in charge and was brought home (on_idle)"
    assert outcome.why == f"{why}; no agent has anything left to do"
    assert not outcome.violations
