"""What befalls a mission in a trial acts on it: each run has one fault, and its journal shows what it did."""

import math
import random
from itertools import combinations
from pathlib import Path
from typing import Any, cast

import pytest

from argosy.recording.reader import Recording
from argosy.trial.faults import Fault, Kill, Operator, Vehicle
from argosy.trial.single_run import Request
from argosy.trial.workers import workers
from argosy.trial.world import World
from schemas.geo import distance
from schemas.wire.records import Perception
from tests.argosy.trial.conftest import MISSIONS, Fly

PROGRAM = """
!fly.
+!fly <- .wait(bridge(up), 120000); set_mode("GUIDED"); arm_motors(true); takeoff(5); goto(-27.603683, -48.518052, 40).
-!fly.
"""
"""A mission that gives up when it fails."""


class Flying:
    """A vehicle in the air, as `Seen` shows it."""

    armed = True

    def __init__(self, at: tuple[float, float], height: float) -> None:
        self.place, self.height = at, height


def test_the_nearest_approach_is_that_of_all_pairs() -> None:
    dice = random.Random(1)
    world = World(cast(Any, None), {}, (), list)
    nearest = math.inf
    for _ in range(5):
        fleet = [Flying((dice.gauss(-27, 1e-4), dice.gauss(-48, 1e-4)), dice.uniform(2, 40)) for _ in range(30)]
        pairs = combinations(fleet, 2)
        apart = (math.hypot(distance(one.place, two.place), one.height - two.height) for one, two in pairs)
        nearest = min(nearest, *apart)
        world.vehicles = cast(Any, dict(enumerate(fleet)))
        world._look_who_is_near()
        assert math.isclose(world.nearest, nearest)


def test_wind_carries_a_mission_off_its_way_and_not_off_its_goals(fly: Fly) -> None:
    still, windy = fly("single_uav", 1), fly("single_uav", 1, Vehicle(robot="uav1", fault="wind=12:200:3"))
    assert windy.success, windy.why
    assert windy.flown > still.flown + 5


def test_a_mission_without_gps_lands_where_it_is(fly: Fly) -> None:
    outcome = fly("single_uav", 1, Vehicle(robot="uav1", fault="gps-loss=15+60"))
    assert "EKF variance" in outcome.why
    assert not outcome.violations


@pytest.mark.parametrize("mission", ["turtle", "paper_turtle"])
def test_a_turtle_draws_in_virtual_time(fly: Fly, mission: str) -> None:
    outcome = fly(mission, 1)
    assert outcome.success, outcome.why
    assert outcome.digest == fly(mission, 1).digest


def test_the_missions_agent_draws_a_square(tmp_path: Path) -> None:
    file = tmp_path / "turtle.mcap"
    with workers(1) as run_all:
        (outcome,) = run_all([Request(str(MISSIONS / "turtle.yaml"), 1, record=str(file))])
    assert outcome.success, outcome.why
    recording = Recording(file)
    poses = [
        cast("tuple[float, float, float]", one.parameters)[:2]
        for _, one in recording.typed(Perception)
        if one.name == "pose"
    ]
    assert math.dist(poses[-1], (3, 3)) < 0.1
    begun = next(number for number, pose in enumerate(poses) if math.dist(pose, (3, 3)) < 0.1)
    drawn = poses[begun:]
    for corner in ((8, 3), (8, 8), (3, 8)):
        assert min(math.dist(corner, pose) for pose in drawn) < 0.1, corner
    assert [(x, y) for x, y in drawn if min(abs(x - 3), abs(x - 8), abs(y - 3), abs(y - 8)) > 0.15] == []


def test_a_turtle_that_the_operator_has_stopped_rests_until_it_is_given_back(fly: Fly) -> None:
    outcome = fly("turtle", 1, Operator(at=6, order="hold", robot="turtle", seconds=60), until=80)
    assert any("operator: hold" in line for line in outcome.journal)
    assert not outcome.violations


def test_a_pilot_ends_the_action_that_runs(fly: Fly) -> None:
    outcome = fly("single_uav", 1, Vehicle(robot="uav1", fault="pilot=15+20:lands"))
    assert "LOITER" in outcome.why
    assert not outcome.violations


@pytest.mark.parametrize(
    ("fault", "program", "done"),
    [
        (
            "pilot=15+20:lands",
            """+override(_) <- .wait(state(_, _, false)); set_mode("GUIDED"); arm_motors(true).""",
            "uav1 was armed again after its pilot had landed it",
        ),
        (
            "pilot=15+60",
            """+override(_) <- .wait(10000); set_mode("GUIDED").""",
            "took uav1 from its pilot, from LOITER to GUIDED",
        ),
    ],
    ids=["landed", "flown"],
)
def test_an_agent_that_takes_a_vehicle_from_its_pilot_breaks_a_rule(
    fly: Fly, tmp_path: Path, fault: str, program: str, done: str
) -> None:
    (tmp_path / "uav.asl").write_text(f"{program}\n{PROGRAM}")
    (tmp_path / "m.yaml").write_text(
        (MISSIONS / "single_uav.yaml").read_text().replace("single_uav/uav.asl", "uav.asl")
    )
    outcome = fly(str(tmp_path / "m"), 1, Vehicle(robot="uav1", fault=fault), until=150)
    found = [one.text for one in outcome.violations if one.rule == "left to the pilot"]
    assert len(found) == 1
    assert done in found[0]


def test_what_the_operator_has_stopped_rests_until_it_is_given_back_also_when_its_bridge_dies(fly: Fly) -> None:
    faults: list[Fault] = [Operator(at=20, order="hold", seconds=20), Kill(at=30, daemon="bridged")]
    outcome = fly("single_uav", 1, *faults)
    ends = [line.split()[3] for line in outcome.journal if "hold confirmed" in line or "released by" in line]
    assert ends == ["hold", "hold", "released"]
    assert not outcome.violations
