"""Planes and rovers: their tables against pymavlink's, their manifests, and their procedures by scripted messages."""

from __future__ import annotations

import asyncio
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
from schemas.manifest.loader import load_manifest
from schemas.wire.log_lines import RobotLeft
from schemas.wire.records import Note
from tests.bridged.scripted import Scripted
from tests.bridged.sky import MISSION, Sky

PLANE, ROVER, QUAD = dialect.MAV_TYPE_FIXED_WING, dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_TYPE_QUADROTOR


def sky_of(tmp_path: Path, vehicle: str, kind: int, modes: ModeTable, mission: str = MISSION, **k: bool) -> Sky:
    return Sky(tmp_path, manifest=load_manifest(vehicle), vehicle=Scripted(kind, modes, **k), mission=mission)  # type: ignore[arg-type]


@pytest.fixture
def plane(tmp_path: Path) -> Sky:
    return sky_of(tmp_path, "plane", PLANE, ARDUPLANE)


@pytest.fixture
def rover(tmp_path: Path) -> Sky:
    return sky_of(tmp_path, "rover", ROVER, ARDUROVER, grounded=True)


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


def test_a_vehicle_that_is_not_what_the_manifest_says_is_not_armed(tmp_path: Path) -> None:
    sky = sky_of(tmp_path, "copter", PLANE, ARDUPLANE)
    sky.wait(3)
    said = (
        'the vehicle reports that it is a MAV_TYPE_FIXED_WING, the manifest says copter; `vehicle = "plane"` would fit'
    )
    assert Note("other_vehicle_kind", said) in sky.driver.notes()
    final = sky.do("arm_motors", True)
    assert (final.state, final.reason) == ("refused", said)
    assert sky.commands(dialect.MAV_CMD_COMPONENT_ARM_DISARM) == []
    state = sky.belief("state")
    assert state is not None
    assert state[0] == "MANUAL", "its modes are read as what it is"


def test_a_vehicle_that_does_not_say_what_it_is_contradicts_nothing() -> None:
    assert contradiction(ARDUCOPTER, dialect.MAV_TYPE_GENERIC) == ""
    assert contradiction(ARDUCOPTER, dialect.MAV_TYPE_HEXAROTOR) == ""
    assert contradiction(ARDUPLANE, dialect.MAV_TYPE_VTOL_TILTROTOR) == ""
    assert "MAV_TYPE_SUBMARINE" in contradiction(ARDUROVER, dialect.MAV_TYPE_SUBMARINE)
    assert table_of(ARDUCOPTER, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, dialect.MAV_TYPE_SUBMARINE) is ARDUCOPTER


@pytest.mark.parametrize(
    ("kind", "modes", "vehicle", "order", "mode"),
    [
        (PLANE, ARDUPLANE, "plane", "hold", "LOITER"),
        (PLANE, ARDUPLANE, "plane", "land", "AUTOLAND"),
        (PLANE, ARDUPLANE, "plane", "rtl", "RTL"),
        (dialect.MAV_TYPE_VTOL_TILTROTOR, ARDUPLANE, "plane", "land", "QLAND"),
        (ROVER, ARDUROVER, "rover", "hold", "HOLD"),
        (ROVER, ARDUROVER, "rover", "land", "HOLD"),
        (ROVER, ARDUROVER, "rover", "rtl", "RTL"),
        (PLANE, ARDUPLANE, "copter", "rtl", "RTL"),
    ],
)
def test_orders_from_above_mean_what_they_can_mean_for_the_vehicle(
    tmp_path: Path, kind: int, modes: ModeTable, vehicle: str, order: str, mode: str
) -> None:
    sky = sky_of(tmp_path, vehicle, kind, modes, grounded=modes.ground)
    scripted = sky.vehicle
    assert isinstance(scripted, Scripted)
    scripted.armed = True
    scripted.at = scripted.at.moved(100, 0, 0 if modes.ground else 50)
    sky.wait(2)
    execution = sky.driver.order(order, by_operator(order), insist=True)  # type: ignore[arg-type]
    sky.forward(lambda: execution.over, "the order", 15)
    assert execution.outcome is not None
    assert execution.outcome.state == "succeeded", execution.outcome.reason
    state = sky.belief("state")
    assert state is not None
    assert state[0] == mode


def test_a_plane_that_refuses_to_land_by_itself_is_taken_home_and_the_order_says_why(plane: Sky) -> None:
    assert plane.do("arm_motors", True).state == "succeeded"
    assert plane.do("takeoff", 60).state == "succeeded"
    autoland = dialect.MAV_CMD_DO_SET_MODE
    plane.pretend(
        lambda one: one.get_type() == "COMMAND_LONG" and one.command == autoland and one.param2 == ARDUPLANE.land,
        dialect.MAV_RESULT_FAILED,
        "AUTOLAND: no takeoff direction",
    )
    execution = plane.driver.order("land", by_operator("land"), insist=True)
    plane.forward(lambda: execution.over, "the order", 30)
    assert execution.outcome is not None
    assert execution.outcome.state == "succeeded"
    assert execution.outcome.reason.startswith("the vehicle is in RTL; the vehicle refused MAV_CMD_DO_SET_MODE")
    assert plane.do("land").state == "refused"


def test_of_orders_with_one_mode_the_mode_carries_out_the_least_safe() -> None:
    assert ARDUROVER.order_of(ARDUROVER.land) == "hold", "`rtl` may follow the HOLD of a rover"
    assert ARDUPLANE.order_of(ARDUPLANE.land) == "land"
    assert {ARDUPLANE_VTOL.order_of(mode) for mode in (20, 26)} == {"land"}
    assert ARDUCOPTER.order_of(21) == "rtl"
    assert ARDUCOPTER.order_of(ARDUCOPTER.guided) is None


def test_a_plane_takes_off_by_its_mode_goes_round_a_place_and_comes_home(plane: Sky) -> None:
    assert plane.do("arm_motors", True).state == "succeeded"
    final = plane.do("takeoff", 60)
    assert final.state == "succeeded", final.reason
    assert plane.vehicle.parameters["TKOFF_ALT"] == 60  # type: ignore[attr-defined]
    assert plane.belief("state") == ("TAKEOFF", True, True)
    final = plane.do("goto", -27.610, -48.5184, 80)
    assert final.state == "succeeded", final.reason
    assert final.feedback["distance"] <= 100, "a plane need not be slow to have arrived"
    assert plane.do("loiter").state == "succeeded"
    final = plane.do("return_to_launch")
    assert final.state == "succeeded", final.reason
    assert plane.belief("state") == ("RTL", True, True)


def test_a_plane_whose_motion_is_cancelled_circles(plane: Sky) -> None:
    plane.do("arm_motors", True)
    plane.do("takeoff", 60)
    heard = plane.begin("goto", -27.64, -48.5184, 80)
    plane.wait(3)
    plane.bridge.action_server.cancel("uav", heard[0].id)
    plane.forward(lambda: plane.belief("state") == ("LOITER", True, True), "LOITER", 5)


def test_a_takeoff_by_mode_to_another_height_is_refused_while_one_is_under_way(plane: Sky) -> None:
    assert plane.do("takeoff", 30).reason.startswith("a takeoff begins armed; the vehicle is not armed")
    plane.do("arm_motors", True)
    plane.do("takeoff", 30)
    assert plane.do("takeoff", 60).reason.startswith("a takeoff to 30 m is under way; the vehicle is armed, in flight")


def test_limits_hold_for_planes_too(tmp_path: Path) -> None:
    mission = MISSION + "    limits: {altitude: 50, radius: 400}\n"
    sky = sky_of(tmp_path, "plane", PLANE, ARDUPLANE, mission)
    sky.do("arm_motors", True)
    assert sky.do("takeoff", 60).reason == "altitude 60 m is above the mission's limit of 50 m"
    assert sky.do("takeoff", 40).state == "succeeded"
    assert "outside the mission's limit of 400 m" in sky.do("goto", -27.62, -48.5184, 40).reason


def test_a_rover_goes_stops_and_comes_home_and_stops_there(rover: Sky) -> None:
    assert rover.do("set_mode", "GUIDED").state == "succeeded"
    assert rover.do("arm_motors", True).state == "succeeded"
    final = rover.do("goto", -27.6045, -48.5184)
    assert final.state == "succeeded", final.reason
    assert rover.belief("speed") == (0.0,)
    assert rover.do("hold").state == "succeeded"
    assert rover.belief("state") == ("HOLD", True, True)
    assert rover.do("goto", -27.6045, -48.5184).reason.startswith("position targets are taken in GUIDED only")
    final = rover.do("return_to_launch")
    assert final.state == "succeeded", final.reason
    assert rover.belief("state") == ("RTL", True, True)


def test_a_rover_whose_motion_is_cancelled_stops(rover: Sky) -> None:
    rover.do("set_mode", "GUIDED")
    rover.do("arm_motors", True)
    heard = rover.begin("goto", -27.61, -48.5184)
    rover.wait(3)
    rover.bridge.action_server.cancel("uav", heard[0].id)
    rover.forward(lambda: rover.belief("state") == ("HOLD", True, True), "HOLD", 5)


def test_the_end_of_the_bridge_sends_a_rover_home(rover: Sky) -> None:
    rover.do("set_mode", "GUIDED")
    rover.do("arm_motors", True)
    orders = rover.bridge.orders
    loop = asyncio.new_event_loop()

    async def shut_down() -> RobotLeft:
        task = loop.create_task(orders.shut_down("rtl"))
        while not task.done():
            rover.step()
            await asyncio.sleep(0)
        return task.result()

    left = loop.run_until_complete(asyncio.wait_for(shut_down(), 20))
    loop.close()
    assert (left.state, left.order) == ("ordered", "rtl")
