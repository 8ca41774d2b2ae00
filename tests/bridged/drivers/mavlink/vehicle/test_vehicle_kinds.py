"""Planes and rovers: their tables against pymavlink's, their manifests, and what only they do."""

from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.safety_orders import by_operator
from bridged.drivers.mavlink.vehicle.flight_modes import (
    ARDUCOPTER,
    ARDUPLANE,
    ARDUPLANE_VTOL,
    ARDUROVER,
    MODE_TABLES,
    ModeTable,
    contradiction,
    table_of,
)
from bridged.drivers.registry import check_manifest
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.manifest.loader import load_manifest
from schemas.wire.records import Note
from tests.bridged.drivers.mavlink.test_six_kinds import sky_of, under_way
from tests.bridged.sky import HOME, MISSION, Sky, end_of, is_command


@pytest.fixture
def plane(tmp_path: Path) -> Sky:
    """Armed in GUIDED."""
    return sky_of(tmp_path, "plane", "ardupilot").armed()


@pytest.mark.parametrize(
    ("table", "theirs"),
    [
        (ARDUCOPTER, mavutil.mode_mapping_acm),
        (ARDUPLANE, mavutil.mode_mapping_apm),
        (ARDUROVER, mavutil.mode_mapping_rover),
    ],
)
def test_modes_are_numbered_as_pymavlink_numbers_them(table: ModeTable, theirs: dict[int, str]) -> None:
    differ = {number: name for number, name in table.names.items() if theirs.get(number, name) != name}
    assert differ == {}
    roles = {table.guided, table.hold, table.land, table.rtl, table.auto, table.after_mission}
    assert roles | table.without_position <= set(table.names)


def test_no_two_kinds_of_vehicle_claim_a_type() -> None:
    tables = (ARDUCOPTER, ARDUPLANE, ARDUPLANE_VTOL, ARDUROVER)
    kinds = [kind for table in tables for kind in table.types]
    assert len(kinds) == len(set(kinds))


@pytest.mark.parametrize("name", MODE_TABLES)
def test_every_vehicle_has_a_manifest_that_nothing_is_wrong_with(name: str) -> None:
    manifest = load_manifest(name)
    assert check_manifest(manifest) == []
    assert manifest.robot.vehicle == name
    assert {"set_mode", "arm_motors", "goto", "return_to_launch", "upload_mission"} <= set(manifest.actions)
    assert {"state", "link", "override", "global_pos", "home_pos"} <= set(manifest.percepts)


def test_a_vehicle_that_is_not_what_the_manifest_says_is_not_armed_and_obeys_in_its_own_modes(tmp_path: Path) -> None:
    flown = sky_of(tmp_path / "plane", "plane", "ardupilot").armed()
    flown.done("takeoff", 40)
    sky = Sky(tmp_path / "copter", vehicle=flown.vehicle)
    sky.wait(3)
    said = (
        'the vehicle reports that it is a MAV_TYPE_FIXED_WING, the manifest says copter; `vehicle = "plane"` would fit'
    )
    assert Note("other_vehicle_kind", said) in sky.driver.notes()
    assert end_of(sky.do("arm_motors", True)) == ("refused", said)
    assert sky.commands(dialect.MAV_CMD_COMPONENT_ARM_DISARM) == []
    execution = sky.driver.order("rtl", by_operator("rtl"), insist=True)
    sky.forward(lambda: execution.over, "the order", 15)
    assert sky.belief("state") == ("RTL", True, True)


def test_a_vehicle_that_does_not_say_what_it_is_contradicts_nothing() -> None:
    assert contradiction(ARDUCOPTER, dialect.MAV_TYPE_GENERIC) == ""
    assert contradiction(ARDUCOPTER, dialect.MAV_TYPE_HEXAROTOR) == ""
    assert contradiction(ARDUPLANE, dialect.MAV_TYPE_VTOL_TILTROTOR) == ""
    assert "MAV_TYPE_SUBMARINE" in contradiction(ARDUROVER, dialect.MAV_TYPE_SUBMARINE)
    ardupilot = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert table_of(ARDUCOPTER, ardupilot, dialect.MAV_TYPE_SUBMARINE) is ARDUCOPTER
    vtol = table_of(ARDUPLANE, ardupilot, dialect.MAV_TYPE_VTOL_TILTROTOR)
    assert vtol.name(vtol.land) == "QLAND"


def test_a_plane_that_refuses_to_land_by_itself_is_taken_home_and_the_order_says_why(plane: Sky) -> None:
    plane.done("takeoff", 60)
    plane.pretend(
        lambda one: is_command(dialect.MAV_CMD_DO_SET_MODE)(one) and one.param2 == ARDUPLANE.land,
        dialect.MAV_RESULT_FAILED,
        "AUTOLAND: no takeoff direction",
    )
    execution = plane.driver.order("land", by_operator("land"), insist=True)
    plane.forward(lambda: execution.over, "the order", 30)
    assert execution.outcome.state == "succeeded"
    assert execution.outcome.reason.startswith("the vehicle is in RTL; the vehicle refused MAV_CMD_DO_SET_MODE")
    assert plane.do("land").state == "refused"


def test_of_orders_with_one_mode_the_mode_carries_out_the_least_safe() -> None:
    assert ARDUROVER.order_of(ARDUROVER.land) == "hold", "`rtl` may follow the HOLD of a rover"
    assert ARDUPLANE.order_of(ARDUPLANE.land) == "land"
    assert {ARDUPLANE_VTOL.order_of(mode) for mode in (20, 26)} == {"land"}
    assert ARDUCOPTER.order_of(21) == "rtl"
    assert ARDUCOPTER.order_of(ARDUCOPTER.guided) is None


@pytest.mark.parametrize(("vehicle", "action", "mode"), [("plane", "loiter", "LOITER"), ("rover", "hold", "HOLD")])
def test_what_cannot_hover_holds_in_its_own_mode_also_when_its_motion_is_cancelled(
    tmp_path: Path, vehicle: str, action: str, mode: str
) -> None:
    sky = sky_of(tmp_path, vehicle, "ardupilot")
    under_way(sky, vehicle)
    sky.bridge.action_server.cancel("uav", sky.statuses[-1].id)
    sky.forward(lambda: sky.belief("state") == (mode, True, True), mode, 5)
    sky.done("set_mode", "GUIDED")
    sky.done(action)
    assert sky.belief("state") == (mode, True, True)


def test_a_rover_takes_targets_in_guided_only(tmp_path: Path) -> None:
    rover = sky_of(tmp_path, "rover", "ardupilot").armed()
    rover.done("hold")
    assert rover.do("goto", -27.6045, -48.5184).reason.startswith("position targets are taken in GUIDED only")


def test_a_takeoff_by_mode_to_another_height_is_refused_while_one_is_under_way(tmp_path: Path) -> None:
    plane = sky_of(tmp_path, "plane", "ardupilot")
    assert plane.do("takeoff", 30).reason.startswith("a takeoff begins armed; the vehicle is not armed")
    plane.armed().begin("takeoff", 80)
    plane.forward(lambda: plane.driver.vehicle.aloft, "the takeoff", 20)
    plane.bridge.action_server.order("hold", by_operator("hold"), block=False, insist=False)
    assert plane.do("takeoff", 60).reason.startswith("a takeoff to 80 m is under way; the vehicle is armed, in flight")


def test_limits_hold_for_planes_too(tmp_path: Path) -> None:
    mission = MISSION.replace("manifest: copter", "manifest: plane") + "    limits: {altitude: 60, radius: 900}\n"
    vehicle = Vehicle(HOME, KINDS["plane", "ardupilot"])
    plane = Sky(tmp_path, vehicle=vehicle, manifest=load_manifest("plane"), mission=mission).armed()
    assert plane.do("takeoff", 70).reason == "altitude 70 m is above the mission's limit of 60 m"
    plane.done("takeoff", 40)
    assert "outside the mission's limit of 900 m" in plane.do("goto", -27.62, -48.5184, 40).reason
