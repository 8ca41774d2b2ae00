"""What a simulated copter is told of the mission's world, and what `argosy check` says of that."""

from collections.abc import Callable
from pathlib import Path

import pytest

from argosy.processes.process_table import Setup, plan
from argosy.processes.simulators import camera_arguments, check_world
from schemas.files.findings import Findings
from schemas.mission.model import Mission, read_mission

WORLD = "world: {victims: 8, seed: 3, area: [-27.6038, -48.5193, -27.6029, -48.5173]}"
TEXT = """
mission: search
agents: {scout: {program: scout.asl, robot: uav1}}
robots:
  uav1:
    manifest: copter
    prefix: uav1
    link: udpin:127.0.0.1:14550
    simulate: {home: [-27.604033, -48.518363, 21.0], camera: 16m, recharge: 60s}
  uav2:
    manifest: copter
    link: udpin:127.0.0.1:14560
    simulate: {home: [-27.604033, -48.518363, 21.0]}
"""


@pytest.fixture
def mission() -> Callable[[str], Mission]:
    return lambda world: read_mission(TEXT + world + "\n", Path("search.yaml"))


def test_a_copter_with_a_camera_is_told_of_the_world_and_whom_to_tell_of_it(mission: Callable[[str], Mission]) -> None:
    told = camera_arguments(mission(WORLD), "uav1", "tcp/127.0.0.1:7447")
    assert told == [
        "--victims=8,3,-27.6038,-48.5193,-27.6029,-48.5173",
        "--camera=16",
        "--camera-key=uav1/victim",
        "--router=tcp/127.0.0.1:7447",
    ]


def test_a_copter_without_a_camera_is_told_nothing(mission: Callable[[str], Mission]) -> None:
    assert camera_arguments(mission(WORLD), "uav2", "tcp/127.0.0.1:7447") == []


def test_servo_logs_are_written_where_the_report_goes_and_only_by_simulators(mission: Callable[[str], Mission]) -> None:
    def logs(folder: Path | None) -> list[str]:
        setup = Setup(mission(WORLD), "tcp/127.0.0.1:7447", 1.0, frozenset(), Path("state"), logs=folder)
        words = [word for process in plan(setup) for word in process.argv]
        return [words[at + 1] for at, word in enumerate(words) if word == "--servo-log"]

    assert logs(Path("report")) == ["report/uav1.servo.jsonl", "report/uav2.servo.jsonl"]
    assert logs(None) == []


@pytest.mark.parametrize(
    ("world", "said"),
    [
        ("", "search.yaml:9:62: error: simulate.camera: the mission has no `world` to look at"),
        (WORLD.replace("-27.6038", "-27.5"), "south below north"),
        (WORLD.replace("8", "900", 1), "the area has no room for 900 victims, 15 m apart"),
    ],
)
def test_a_world_that_cannot_be_is_told_at_its_line(mission: Callable[[str], Mission], world: str, said: str) -> None:
    (finding,) = check_world(mission(world))
    assert said in str(finding)


def test_a_world_that_can_be_is_fine(mission: Callable[[str], Mission]) -> None:
    assert check_world(mission(WORLD)) == []


def test_a_world_without_an_area_is_none(mission: Callable[[str], Mission]) -> None:
    with pytest.raises(Findings, match="area"):
        mission("world: {victims: 8}")
