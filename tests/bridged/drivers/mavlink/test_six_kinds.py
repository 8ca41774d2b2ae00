"""Copter, plane and rover of ArduPilot and of PX4: the same actions and orders by the manifest of each kind."""

from pathlib import Path

import pytest

from bridged.bridge.safety_orders import Step, by_operator
from bridged.drivers.api import Order
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.manifest.loader import load_manifest
from tests.bridged.bridge.test_safety_orders import passing
from tests.bridged.sky import HOME, MISSION, Sky, end_of

NORTH = (-27.6000, -48.5184)
"""450 m north of home."""
FAR = (-27.5900, -48.5184)
ALL = sorted(KINDS)
ORDERED = {
    ("copter", "ardupilot"): {"hold": "BRAKE", "land": "LAND", "rtl": "RTL"},
    ("copter", "px4"): {"hold": "GUIDED", "land": "LAND", "rtl": "RTL"},
    ("plane", "ardupilot"): {"hold": "LOITER", "land": "AUTOLAND", "rtl": "RTL"},
    ("plane", "px4"): {"hold": "GUIDED", "land": "RTL", "rtl": "RTL"},
    ("rover", "ardupilot"): {"hold": "HOLD", "land": "HOLD", "rtl": "RTL"},
    ("rover", "px4"): {"hold": "GUIDED", "land": "LAND", "rtl": "RTL"},
}
"""The mode that each order means for each kind."""


def sky_of(tmp_path: Path, vehicle: str, autopilot: str, flown: Vehicle | None = None) -> Sky:
    mission = MISSION.replace("manifest: copter", f"manifest: {vehicle}")
    flown = flown or Vehicle(HOME, KINDS[vehicle, autopilot])
    return Sky(tmp_path, vehicle=flown, manifest=load_manifest(vehicle), mission=mission)


def aloft(vehicle: str, place: tuple[float, float]) -> tuple[float, ...]:
    """Return a place for a `goto` of a vehicle: 40 m high, unless it drives."""
    return place if vehicle == "rover" else (*place, 40)


def under_way(sky: Sky, vehicle: str, place: tuple[float, float] = FAR) -> None:
    """Depart, and be on the way to a place."""
    sky.armed()
    if vehicle != "rover":
        sky.done("takeoff", 40)
    sky.begin("goto", *aloft(vehicle, place))
    sky.forward(lambda: sky.driver.vehicle.speed > 3, "it moves", 30)
    sky.wait(3)


def mode(sky: Sky) -> object:
    state = sky.belief("state")
    return None if state is None else state[0]


@pytest.mark.parametrize(("vehicle", "autopilot"), ALL)
def test_it_departs_goes_to_a_place_and_comes_home(tmp_path: Path, vehicle: str, autopilot: str) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    sky.armed()
    if vehicle != "rover":
        sky.done("takeoff", 40)
    sky.done("goto", *aloft(vehicle, NORTH))
    sky.done("return_to_launch")
    assert sky.belief("override") is None
    assert sky.driver.notes() == []


@pytest.mark.parametrize("order", ["hold", "land", "rtl"])
@pytest.mark.parametrize(("vehicle", "autopilot"), ALL)
def test_an_operators_order_is_confirmed_under_way(tmp_path: Path, vehicle: str, autopilot: str, order: Order) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    under_way(sky, vehicle)
    execution = sky.bridge.action_server.order(order, by_operator(order), block=True, insist=True)
    sky.forward(lambda: execution.over, "the order", 15)
    assert execution.outcome.state == "succeeded", execution.outcome.reason
    assert mode(sky) == ORDERED[vehicle, autopilot][order]
    if order == "hold" and vehicle != "plane":
        sky.forward(lambda: sky.driver.vehicle.speed < 0.3, "it stands still", 10)


@pytest.mark.parametrize(("vehicle", "autopilot"), ALL)
async def test_a_lost_agents_vehicle_holds_and_returns(tmp_path: Path, vehicle: str, autopilot: str) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    under_way(sky, vehicle)
    sky.bridge.orders.agent_lost("uav", "a test", (Step("hold", 5.0), Step("rtl")))
    await passing(sky, 4)
    assert mode(sky) == ORDERED[vehicle, autopilot]["hold"]
    await passing(sky, 8)
    assert mode(sky) == "RTL"


@pytest.mark.parametrize(("vehicle", "autopilot"), ALL)
def test_a_stored_mission_is_flown_to_its_end(tmp_path: Path, vehicle: str, autopilot: str) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    there = [[-27.6020, -48.5184, 40], [-27.6030, -48.5170, 40]]
    items = there if vehicle == "rover" else [["takeoff", 0, 0, 40], *there]
    sky.done("set_mode", "GUIDED")
    sky.done("upload_mission", items)
    sky.done("arm_motors", True)
    sky.done("start_mission")
    sky.done("return_to_launch")
    assert sky.belief("override") is None


@pytest.mark.parametrize(("vehicle", "autopilot"), ALL)
def test_what_is_asked_of_a_bridge_that_was_started_again_in_flight_waits_for_the_vehicles_reports(
    tmp_path: Path, vehicle: str, autopilot: str
) -> None:
    before = sky_of(tmp_path / "before", vehicle, autopilot)
    under_way(before, vehicle)
    after = sky_of(tmp_path / "after", vehicle, autopilot, before.vehicle)
    after.done("goto", *aloft(vehicle, NORTH))


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_planes_takeoff_under_way_is_joined_and_goes_on_from_any_height(tmp_path: Path, autopilot: str) -> None:
    before = sky_of(tmp_path / "before", "plane", autopilot)
    before.armed()
    before.begin("takeoff", 40)
    before.forward(lambda: before.driver.vehicle.aloft, "the takeoff", 20)
    after = sky_of(tmp_path / "after", "plane", autopilot, before.vehicle)
    after.done("takeoff", 40)
    after.done("set_mode", "GUIDED")
    after.done("takeoff", 70)
    assert after.driver.vehicle.position.altitude == pytest.approx(70, abs=10)


LANDING = [
    ["MAV_CMD_DO_LAND_START"],
    ["MAV_CMD_NAV_LOITER_TO_ALT", -27.604033, -48.510447, 40, 0, 60, 0, 1],
    ["land", -27.604033, -48.518363, 0],
]
"""From 780 m east of home: not steeper than PX4's FW_LND_ANG."""


def test_a_mission_that_is_uploaded_at_once_waits_for_home(tmp_path: Path) -> None:
    mission = MISSION.replace("manifest: copter", "manifest: plane") + "    limits: {altitude: 100, radius: 1000}\n"
    sky = Sky(tmp_path, vehicle=Vehicle(HOME, KINDS["plane", "px4"]), manifest=load_manifest("plane"), mission=mission)
    sky.done("upload_mission", LANDING)
    assert sky.do("upload_mission", [[-27.5, -48.518363, 40]]).state == "refused"


def test_a_px4_plane_lands_by_the_landing_of_its_mission(tmp_path: Path) -> None:
    sky = sky_of(tmp_path, "plane", "px4")
    sky.done("upload_mission", LANDING)
    under_way(sky, "plane", NORTH)
    sky.done("land")
    assert sky.belief("state") == ("AUTO", True, False)
    assert sky.belief("override") is None
    assert sky.driver.vehicle.position is not None
    assert sky.driver.vehicle.home.distance(sky.driver.vehicle.position) < 60


@pytest.mark.parametrize(
    ("items", "rtl_type", "why"),
    [
        ([], 1, "and its mission has no landing: upload one with an item `land`"),
        (LANDING, 0, "and it flies the landing of its mission with RTL_TYPE 1, which is 0"),
    ],
)
def test_a_px4_plane_lands_by_a_landing(tmp_path: Path, items: list[list[object]], rtl_type: int, why: str) -> None:
    sky = sky_of(tmp_path, "plane", "px4")
    if items:
        sky.done("upload_mission", items)
    sky.done("set_param", "RTL_TYPE", rtl_type)
    under_way(sky, "plane", NORTH)
    assert end_of(sky.do("land")) == ("refused", f"a plane of this kind has no mode that lands where it is, {why}")
    assert mode(sky) == "GUIDED"


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_takeoff_of_a_plane_does_not_lead_down(tmp_path: Path, autopilot: str) -> None:
    sky = sky_of(tmp_path, "plane", autopilot)
    sky.armed()
    sky.done("takeoff", 90)
    sky.done("set_mode", "GUIDED")
    sky.wait(5)
    final = sky.do("takeoff", 30)
    assert final.state == "refused"
    assert final.reason.startswith("a takeoff to 30 m does not lead down from ")
