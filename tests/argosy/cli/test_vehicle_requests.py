"""`argosy params` and `argosy plan save` against a running mission: real daemons and a simulated copter."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bridged.drivers.mavlink.plan_files import read_plan
from schemas.humanize import size
from tests.argosy.tools.flying import Trial, trial
from tests.support import forked
from tests.support.processes import ROOT


@pytest.fixture(scope="module")
def parked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trial]:
    with trial(tmp_path_factory.mktemp("trial")) as mission:
        mission.bridged.says("is heard")
        yield mission


def argosy(mission: Trial, *words: str) -> tuple[int, list[str], str]:
    """Type a command; return its exit code, the lines that it printed, and what it said besides."""
    done = forked.run(["argosy", *words, "--router", mission.endpoint], timeout=120, cwd=ROOT)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout.splitlines(), done.stderr.strip()


@pytest.fixture(scope="module")
def saved(parked: Trial, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of the vehicle's parameters."""
    path = tmp_path_factory.mktemp("saved") / "uav1.param"
    code, (line,), said = argosy(parked, "params", "save", "uav1", str(path))
    assert (code, said) == (0, "")
    assert line.endswith("parameters of uav1")
    return path


def test_what_was_saved_does_not_differ_and_is_not_overwritten(parked: Trial, saved: Path) -> None:
    code, lines, said = argosy(parked, "params", "diff", "uav1", str(saved))
    assert (code, len(lines), said) == (0, 1, ""), lines
    assert lines[0].startswith("uav1: 0 parameters differ;")
    code, _, said = argosy(parked, "params", "save", "uav1", str(saved))
    assert (code, "--force" in said) == (2, True)


def test_what_differs_is_set_and_confirmed_but_for_safety_unless_it_is_named(parked: Trial, tmp_path: Path) -> None:
    path = tmp_path / "new.params"
    path.write_text("1\t1\tWPNAV_SPEED\t700\t9\n1\t1\tFENCE_RADIUS\t120\t9\n1\t1\tNO_SUCH\t1\t6\n")
    code, lines, _ = argosy(parked, "params", "diff", "uav1", str(path))
    assert code == 1
    assert lines[:2] == ["WPNAV_SPEED   1000  ->  700", "FENCE_RADIUS   300  ->  120    safety: geofence"]
    assert lines[2].startswith("uav1: 2 parameters differ; 0 equal; 1 that the vehicle does not have: NO_SUCH;")
    code, _, said = argosy(parked, "params", "load", "uav1", str(path))
    assert (code, "confirm by --yes" in said) == (2, True)
    code, lines, said = argosy(parked, "params", "load", "uav1", str(path), "--yes")
    assert (code, lines[3:]) == (1, ["uav1: WPNAV_SPEED = 700", "uav1: 1 of 1 parameter set"])
    assert "--allow-safety FENCE_RADIUS" in said
    code, lines, _ = argosy(parked, "params", "load", "uav1", str(path), "--yes", "--allow-safety", "FENCE_RADIUS")
    assert (code, lines[-1]) == (1, "uav1: 1 of 1 parameter set"), "NO_SUCH is still not in the vehicle"
    path.write_text("WPNAV_SPEED 700\nFENCE_RADIUS 120\n")
    assert argosy(parked, "params", "load", "uav1", str(path), "--yes")[0] == 0
    code, _, said = argosy(parked, "params", "load", "uav1", str(path), "--allow-safety", "FENCE_RADIU")
    assert (code, "did you mean `FENCE_RADIUS`" in said) == (2, True)


def test_a_value_that_the_vehicle_does_not_take_is_no_success(parked: Trial, tmp_path: Path) -> None:
    path = tmp_path / "odd.param"
    path.write_text("LAND_SPEED,40000\nRC_OVERRIDE_TIME,2.5\n")
    code, lines, said = argosy(parked, "params", "load", "uav1", str(path), "--yes")
    assert code == 1
    assert "LAND_SPEED NOT set: LAND_SPEED: 40000 was asked for, the vehicle has 32767" in said
    assert lines[-2:] == ["uav1: RC_OVERRIDE_TIME = 2.5", "uav1: 1 of 2 parameters set; 1 not confirmed: LAND_SPEED"]


def test_nothing_is_set_while_the_vehicle_is_armed(parked: Trial, tmp_path: Path) -> None:
    for action in (("set_mode", "GUIDED"), ("arm_motors", "true")):
        assert argosy(parked, "act", "uav", *action)[0] == 0
    path = tmp_path / "more.param"
    path.write_text("LOIT_SPEED,1000\nGUID_TIMEOUT,4\n")
    code, lines, said = argosy(parked, "params", "load", "uav1", str(path), "--yes")
    assert (code, lines[-1]) == (1, "uav1: 0 of 2 parameters set; 2 not confirmed: LOIT_SPEED and GUID_TIMEOUT")
    assert said == "uav1: LOIT_SPEED NOT set: the vehicle is armed; parameters are set while it is not"
    assert argosy(parked, "act", "uav", "arm_motors", "false")[0] == 0


@pytest.mark.parametrize("end", [".plan", ".waypoints"])
def test_the_stored_mission_is_saved_for_ground_stations_and_argosy(parked: Trial, tmp_path: Path, end: str) -> None:
    items = '[["takeoff", 0, 0, 10], [-27.603683, -48.518052, 20.5], ["rtl"]]'
    assert argosy(parked, "act", "uav", "upload_mission", items)[0] == 0
    path = tmp_path / f"flown{end}"
    code, lines, said = argosy(parked, "plan", "save", "uav1", str(path))
    assert (code, lines, said) == (0, [f"{path}: 3 items"], "")
    assert [(item.command, item.z) for item in read_plan(path).items] == [(22, 10), (16, 20.5), (20, 0)]
    assert argosy(parked, "plan", "save", "uav1", str(path))[0] == 2
    assert argosy(parked, "plan", "save", "uav1", str(path), "--force")[0] == 0


def test_a_log_is_downloaded_by_hand_and_the_command_says_where_it_is(parked: Trial) -> None:
    code, lines, said = argosy(parked, "act", "uav", "download_log")
    (path,) = (parked.path.parent / "state" / "trial" / "logs").iterdir()
    assert (code, said) == (0, "")
    assert lines[-1] == f"uav: download_log succeeded: log 1, {size(path.stat().st_size)}, is in {path}"


def test_nothing_is_written_without_a_mission_a_robot_or_a_known_kind_of_file(parked: Trial, tmp_path: Path) -> None:
    assert argosy(parked, "act", "uav", "clear_mission")[0] == 0
    code, _, said = argosy(parked, "plan", "save", "uav1", str(tmp_path / "a.plan"))
    assert (code, said) == (1, "error: uav1: the vehicle stores no mission")
    assert argosy(parked, "plan", "save", "uav2", str(tmp_path / "a.plan"))[0] == 1
    assert argosy(parked, "plan", "save", "uav1", str(tmp_path / "a.txt"))[0] == 2
    assert list(tmp_path.iterdir()) == []


def test_parameters_are_read_but_not_set_where_the_mission_allows_nothing_by_hand(tmp_path: Path) -> None:
    path = tmp_path / "new.param"
    path.write_text("WPNAV_SPEED,700\nLOIT_SPEED,1000\n")
    with trial(tmp_path / "trial", inject=False) as mission:
        mission.bridged.says("is heard")
        assert argosy(mission, "params", "diff", "uav1", str(path))[0] == 1
        code, lines, said = argosy(mission, "params", "load", "uav1", str(path), "--yes")
        assert (code, "inject: true" in said, said.count("NOT set")) == (1, True, 1)
        assert argosy(mission, "params", "diff", "uav1", str(path))[1][:2] == lines[:2], "both still differ"
