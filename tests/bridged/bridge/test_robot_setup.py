"""Wrong missions, manifests and links: said at their line before anything starts."""

from pathlib import Path

import pytest

from bridged.bridge.robot_setup import prepare, prepare_all
from schemas.files.findings import Findings
from schemas.mission.model import read_mission
from tests.bridged.sky import MISSION
from tests.support.processes import running


def problems(
    text: str, tmp_path: Path, *, robot: str = "uav1", link: str | None = None, speed: float = 1.0
) -> list[str]:
    mission = read_mission(text, tmp_path / "m.yaml")
    try:
        prepare(mission, robot, link, speed)
    except Findings as found:
        return [str(one).replace(str(tmp_path) + "/", "") for one in found.findings]
    return []


def test_a_good_mission_is_taken_and_the_command_line_chooses_the_link(tmp_path: Path) -> None:
    mission = read_mission(MISSION, tmp_path / "m.yaml")
    ready, part = prepare(mission, "uav1", "tcp:127.0.0.1:5760", 5.0)
    assert ready.robots["uav1"].link == "tcp:127.0.0.1:5760"
    assert "takeoff" in part.manifest.actions
    assert [(step.order, step.pause) for step in part.steps] == [("hold", 5.0), ("rtl", 0.0)]


def test_people_are_told_where_a_robot_is_by_its_link_its_prefix_or_its_driver(tmp_path: Path) -> None:
    (tmp_path / "quiet.toml").write_text('[robot]\ndriver = "zenoh"\n')
    text = MISSION.replace(
        "robots:", "robots:\n  quiet: {manifest: quiet.toml}\n  far: {manifest: quiet.toml, prefix: a/b}"
    )
    mission = read_mission(text, tmp_path / "m.yaml")
    _, parts = prepare_all(mission, ["uav1", "quiet", "far"], None, 1.0)
    assert [part.where for part in parts] == ["udpin:127.0.0.1:0", "driver `zenoh`", "a/b/**"]


def test_a_bridge_is_not_given_a_vehicle_without_a_link_also_if_it_is_simulated(tmp_path: Path) -> None:
    text = MISSION.replace("    link: udpin:127.0.0.1:0\n", "")
    assert problems(text, tmp_path) == [], "a run finds one"
    with pytest.raises(Findings, match=r"m\.yaml:8:5: error: uav1 needs the field `link`: udpin:"):
        prepare_all(read_mission(text, tmp_path / "m.yaml"), ["uav1"], None, 1.0)


def test_everything_that_is_wrong_with_a_robot_is_told_at_once(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('[robot]\ndriver = "mavlink"\nvehicle = "boat"\n')
    text = (
        MISSION.replace("manifest: copter", "manifest: bad.toml")
        .replace("udpin:127.0.0.1:0", "udp:1")
        .replace("    simulate:", "    on_agent_loss: [hover, land 3 parsecs]\n    simulate:")
    )
    assert problems(text, tmp_path) == [
        "bad.toml:3: error: robot.vehicle: the mavlink driver has no `boat`, it has copter, plane, rover",
        "m.yaml:9:11: error: link 'udp:1': expected udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT "
        "or serial:DEVICE:BAUD",
        "m.yaml:10:21: error: on_agent_loss: Expected hold, land or rtl, got `hover`",
        "m.yaml:10:28: error: on_agent_loss: Expected a duration such as `5s`, `500ms` or `15min`, got `3 parsecs`",
    ]


def test_a_real_robot_is_not_hurried(tmp_path: Path) -> None:
    text = "\n".join(line for line in MISSION.splitlines() if "simulate" not in line)
    assert problems(text, tmp_path, speed=5) == [
        "m.yaml:8:5: error: speed 5: only a simulated robot can have another speed than 1"
    ]
    assert problems(text, tmp_path, speed=1) == []


def test_a_robot_that_there_is_not_is_told_with_those_there_are(tmp_path: Path) -> None:
    [problem] = problems(MISSION, tmp_path, robot="uav7")
    assert problem.endswith("error: there is no robot `uav7`, there is uav1")


def test_a_wrong_file_ends_the_daemon_with_exit_2_and_one_line(tmp_path: Path) -> None:
    file = tmp_path / "m.yaml"
    file.write_text(MISSION.replace("copter", "px4"))
    (tmp_path / "uav.asl").write_text("")
    with running("bridged", "serve", str(file), "uav1", "--speed", "1") as daemon:
        assert daemon.ends() == 2
        assert len(daemon.lines) == 1
        assert "no such manifest" in daemon.text


def test_an_order_that_a_robot_does_not_have_is_told_where_the_mission_declares_it(tmp_path: Path) -> None:
    text = MISSION.replace("manifest: copter", "manifest: turtle\n    on_agent_loss: [hold 5s, land]")
    text = text.replace("    link: udpin:127.0.0.1:0\n", "    on_shutdown: rtl\n")
    assert sorted(problems(text, tmp_path)) == [
        "m.yaml:10:18: error: on_shutdown: the robot has no order `rtl`, it has hold",
        "m.yaml:9:30: error: on_agent_loss: the robot has no order `land`, it has hold",
    ]
    assert problems(text.replace("    on_shutdown: rtl\n", "").replace(", land", ""), tmp_path) == []
