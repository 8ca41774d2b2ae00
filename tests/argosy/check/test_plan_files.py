"""What `argosy check` says of plan files that programs name, and which board gets them."""

from pathlib import Path

import pytest

from argosy.check.command import check_mission
from argosy.deploy.board_needs import files_of
from schemas.mission.model import load_mission
from tests.bridged.drivers.mavlink.test_plan_files import NEAR, TAKEOFF, THERE, plan, simple

MISSION = """\
mission: m
boards: {pi1: {address: 10.0.0.11}, pi2: {address: 10.0.0.12}}
agents: {uav: {program: uav.asl, robot: uav1, board: pi2}}
done: "uav: done"
robots:
  uav1:
    board: pi1
    manifest: MANIFEST
    link: udpin:127.0.0.1:14550
    limits: {altitude: 30}
"""
OWN = '[actions.survey]\ncall = "plan_upload"\nfields = {file = {value = "plans/a.plan"}}\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A mission beside which there is a plan."""
    (tmp_path / "plans").mkdir()
    (tmp_path / "plans" / "a.plan").write_text(plan(TAKEOFF, THERE))
    (tmp_path / "m.yaml").write_text(MISSION.replace("MANIFEST", "own.toml"))
    (tmp_path / "own.toml").write_text('[robot]\ndriver = "mavlink"\nvehicle = "copter"\n' + OWN + UPLOAD)
    return tmp_path


UPLOAD = '[actions.upload_plan]\nparams = [{name = "file", type = "string"}]\ncall = "plan_upload"\n'


def said(folder: Path, step: str) -> list[tuple[int, str, str]]:
    """Return line, severity and text of the findings about a program with this step."""
    (folder / "uav.asl").write_text(f"!fly.\n+!fly <-\n  {step};\n  +done.\n")
    found = check_mission(folder / "m.yaml")[1]
    return [(one.line, one.severity, one.message) for one in found if one.file.endswith("uav.asl")]


@pytest.mark.parametrize(
    ("step", "text"),
    [
        ('upload_plan("plans/b.plan")', "the action upload_plan: plans/b.plan: there is no such file on this machine"),
        ('upload_plan("../a.plan")', "relative to the mission file, without `..`, got '../a.plan'"),
        ('upload_plan("plans/high.plan")', "item 1: altitude 31 m is above the mission's limit of 30 m"),
        ('upload_plan("plans/terrain.plan")', "item 1: an altitude above terrain cannot be compared"),
        ('upload_plan("plans/bad.plan")', "plans/bad.plan: expected a plan of QGroundControl"),
    ],
)
def test_a_plan_file_the_bridge_would_refuse_is_an_error_where_it_is_named(folder: Path, step: str, text: str) -> None:
    (folder / "plans" / "high.plan").write_text(plan(simple(16, 0, 0, 0, None, *NEAR, 31)))
    (folder / "plans" / "terrain.plan").write_text(plan(simple(16, 0, 0, 0, None, *NEAR, 5, frame=10)))
    (folder / "plans" / "bad.plan").write_text("home")
    ((line, severity, message),) = said(folder, step)
    assert (line, severity) == (3, "error")
    assert text in message


def test_a_plan_that_can_be_used_and_a_name_that_only_the_run_knows_are_fine(folder: Path) -> None:
    assert said(folder, 'upload_plan("plans/a.plan")') == []
    assert said(folder, '.concat("plans/", "b.plan", F); upload_plan(F)') == []
    assert said(folder, "survey") == []


def test_a_fence_in_a_plan_is_told_to_be_not_taken(folder: Path) -> None:
    (folder / "plans" / "a.plan").write_text(plan(THERE, geoFence={"breachReturn": [-27.6, -48.5, 20]}))
    ((line, severity, message),) = said(folder, "survey")
    assert (line, severity) == (3, "warning")
    assert message.endswith("plans/a.plan: not taken from the file: the breach return point")


def test_the_board_of_the_robot_gets_the_plans_that_programs_name(folder: Path) -> None:
    assert said(folder, 'upload_plan("plans/a.plan")') == []
    mission = load_mission(folder / "m.yaml")
    assert "plans/a.plan" in files_of(mission, "pi1")
    assert "plans/a.plan" not in files_of(mission, "pi2")
