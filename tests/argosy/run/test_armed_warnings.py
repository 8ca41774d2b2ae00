"""What the summary says of vehicles that were left armed."""

from dataclasses import replace

import pytest

from argosy.run.armed_warnings import in_the_air, last_line
from argosy.run.end_conditions import Ending
from argosy.run.summary import summary
from schemas.mission.model import Failsafe
from schemas.wire.log_lines import RobotLeft
from schemas.wire.terms import Term
from tests.argosy.recorded import START, Recording

FAILED = Ending(1, "failed: for a test")
HOME = RobotLeft(robot="uav1", state="ordered", order="rtl", text="rtl: the vehicle does it")
DISARMED = RobotLeft(robot="uav1", state="disarmed", text="not armed")
PILOTED = RobotLeft(robot="uav1", state="piloted", text="left to the pilot in LOITER, armed")
SILENT = RobotLeft(robot="uav1", state="unconfirmed", text="armed, and it has not confirmed rtl: no answer")
TAKE_OVER = (
    "MAY STILL BE IN THE AIR: last heard 12 s ago, armed, GUIDED, 39 m up; {}; "
    "nothing brings it home: take over with the transmitter or ground station"
)


def airborne(*, real: bool = True) -> Recording:
    """Return a recording that ends 12 s after the vehicle was last heard, armed and 39 m up."""
    recording = Recording(1.0)
    recording.status.setup = replace(recording.status.setup, real=frozenset({"uav1"} if real else ()))
    recording.percept("state", "GUIDED", True, True)
    recording.percept("altitude", 39.0)
    recording.at = 12.0
    return recording


def last_words(recording: Recording) -> str:
    """Return the last line of the summary."""
    return summary(recording.status, FAILED, [("startup", 1.0)]).splitlines()[-1]


@pytest.mark.parametrize(
    ("left", "killed", "real", "told"),
    [
        (HOME, False, True, "IS STILL IN THE AIR: RTL confirmed by its bridge; nobody watches it now"),
        (PILOTED, False, True, "IS STILL IN THE AIR: left to the pilot in LOITER, armed; nobody else watches it now"),
        (
            HOME,
            False,
            False,
            "WAS STILL IN THE AIR: RTL confirmed by its bridge; it is simulated and ended with the run",
        ),
        (SILENT, False, True, TAKE_OVER.format("its bridge reports: armed, and it has not confirmed rtl: no answer")),
        (None, True, True, TAKE_OVER.format("its bridge did not leave and was killed, no order was confirmed")),
        (None, False, True, TAKE_OVER.format("its bridge reports nothing, no order was confirmed")),
    ],
    ids=["on its way home", "piloted", "simulated", "not confirmed", "bridge killed", "bridge silent"],
)
def test_a_vehicle_aloft_is_in_the_summarys_end(left: RobotLeft | None, killed: bool, real: bool, told: str) -> None:
    recording = airborne(real=real)
    recording.status.killed |= {"uav1"} if killed else set()
    recording.status.left |= {"uav1": left} if left else {}
    assert last_words(recording) == f"uav1 {told}"


def test_a_lost_vehicle_that_was_armed_may_be_flying_and_the_summary_keeps_its_last_state() -> None:
    recording = airborne()
    recording.percept("state", "", False, False)
    recording.status.left["uav1"] = DISARMED
    assert last_words(recording).startswith("uav1 MAY STILL BE IN THE AIR: last heard 12 s ago, armed, GUIDED, 39 m up")
    text = summary(recording.status, FAILED, [("startup", 1.0)])
    assert "  uav1       LOST, last heard 12 s ago: GUIDED, armed, 39.0 m above home" in text


@pytest.mark.parametrize(("name", "term"), [("holder", "uav"), ("paused", True)])
def test_what_a_bridge_knows_without_its_vehicle_is_no_word_of_the_vehicle(name: str, term: Term) -> None:
    """A bridge that was started again says at once who holds its robot: it has not heard the vehicle by that."""
    recording = airborne()
    robot = recording.model.robots["uav1"].seen
    heard = robot.heard
    recording.percept(name, term)
    assert getattr(robot, name) == term
    assert robot.heard == heard < recording.model.now()
    recording.percept("altitude", 38.0)
    assert robot.heard > heard


def test_a_vehicle_whose_bridge_died_is_heard_again_by_its_state_alone() -> None:
    """A bridge that was started again tells positions before the first HEARTBEAT: it cannot bring it home by them."""
    recording = airborne()
    robot = recording.model.robots["uav1"].seen
    recording.health("uav1", "bridged")
    recording.model.bridge_died("uav1")
    recording.at = 14.0
    recording.percept("global_pos", -27.6, -48.5)
    assert (robot.lost, robot.armed, robot.heard) == (True, True, START + 12.0)
    recording.percept("state", "GUIDED", True, True)
    assert (robot.lost, robot.heard) == (False, START + 14.0)


def test_a_vehicle_that_its_bridge_found_disarmed_is_not_called_flying() -> None:
    recording = airborne()
    recording.status.left["uav1"] = DISARMED
    assert in_the_air(recording.status) == []


def test_data_of_a_frozen_bridge_is_marked_with_its_age() -> None:
    recording = airborne()
    recording.status.frozen.add("uav1")
    text = summary(recording.status, FAILED, [("startup", 1.0)])
    assert "  uav1       12 s ago: GUIDED, armed, 39.0 m above home" in text


def test_the_vehicles_own_failsafe_is_counted_on_only_if_the_mission_has_one() -> None:
    recording = airborne()
    assert last_line(recording.status, "uav1").startswith("nothing brings it home: take over")
    mission = recording.status.setup.mission
    robot = type(mission.robots["uav1"])(manifest="copter", link="udpin:1:1", failsafe=Failsafe(gcs="human"))
    recording.status.setup = replace(recording.status.setup, mission=replace(mission, robots={"uav1": robot}))
    assert last_line(recording.status, "uav1").startswith("only its own failsafe brings it home: take over")
