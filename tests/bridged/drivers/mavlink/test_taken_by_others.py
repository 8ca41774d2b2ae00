"""Who else has the vehicle, seen late or not at all: no action takes it from them, and none waits for it for ever."""

import math
from itertools import product
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.safety_orders import by_operator
from bridged.drivers.mavlink.actions import arrival
from tests.bridged.drivers.mavlink.test_six_kinds import ALL, FAR, NORTH, aloft, mode, sky_of, under_way
from tests.bridged.sky import GOAL, HOME, Message, Sky

ALT_HOLD, LOITER = 2, 5
UNHEARD = ("HEARTBEAT", "COMMAND_ACK", "POSITION_TARGET_GLOBAL_INT")


def unheard(message: Message) -> bool:
    """Whether a message reaches the bridge: all but those that show or acknowledge a mode."""
    return message.get_type() not in UNHEARD


@pytest.mark.parametrize(
    ("asked", "arguments"), [("set_mode", ["BRAKE"]), ("return_to_launch", []), ("land", []), ("reposition", [*GOAL])]
)
def test_a_mode_whose_acknowledgement_is_lost_is_not_set_again_while_no_heartbeat_shows_who_has_the_vehicle(
    sky: Sky, asked: str, arguments: list[object]
) -> None:
    sky.flying(20)
    sky.we_hear = unheard
    heard = sky.begin(asked, *arguments)
    sky.wait(0.4)
    sky.pilot_sets(ALT_HOLD)
    sky.wait(3)
    sky.we_hear = lambda message: True
    sky.end(heard, 10)
    assert sky.vehicle.autopilot.mode == ALT_HOLD
    assert heard[-1].state == "failed"
    sky.forward(lambda: sky.belief("override") == ("ALT_HOLD",), "the override", 2)


def sends_home(sky: Sky) -> None:
    """Another ground station sends the vehicle home."""
    parameters = (0.0,) * 7
    request = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0, *parameters)
    sky.downlink.extend(sky.vehicle.receive(request))


@pytest.mark.parametrize(("vehicle", "autopilot"), ALL)
def test_a_target_that_is_not_reported_is_not_sent_again_while_no_heartbeat_shows_who_has_the_vehicle(
    tmp_path: Path, vehicle: str, autopilot: str
) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    under_way(sky, vehicle)
    sky.we_hear = unheard
    heard = sky.begin("setpoint" if vehicle == "copter" else "goto", *aloft(vehicle, NORTH))
    sky.wait(0.4)
    sends_home(sky)
    sky.wait(3)
    sky.we_hear = lambda message: True
    sky.end(heard, 10)
    sky.forward(lambda: sky.belief("override") == ("RTL",), "the override", 3)
    assert mode(sky) == "RTL"


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "asked"),
    [
        (*kind, asked)
        for kind, asked in product(ALL, ("cancel", "goto", "set_mode", "land"))
        if (kind[0], asked) != ("rover", "land")  # it has no such action
    ],
)
def test_what_is_asked_while_no_heartbeat_comes_does_not_take_the_vehicle_from_others(
    tmp_path: Path, vehicle: str, autopilot: str, asked: str
) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    under_way(sky, vehicle)
    sky.we_hear = unheard
    sends_home(sky)
    sky.wait(2.5)
    if asked == "cancel":
        sky.bridge.action_server.cancel("uav", sky.statuses[-1].id, "uav")
    else:
        arguments = {"set_mode": ["GUIDED"], "goto": [*aloft(vehicle, NORTH)], "land": []}
        sky.begin(asked, *arguments[asked])
    sky.wait(1)
    sky.we_hear = lambda message: True
    sky.forward(lambda: sky.belief("override") == ("RTL",), "the override", 3)
    sky.wait(3)
    assert mode(sky) == "RTL"


def test_a_mode_that_a_pilot_leaves_for_the_one_before_is_not_set_again(sky: Sky) -> None:
    sky.flying(20)
    sky.pilot_sets(LOITER)
    sky.forward(lambda: sky.belief("override"), "the pilot's mode", 3)
    sky.we_hear = lambda message: message.get_type() != "HEARTBEAT"
    heard = sky.begin("set_mode", "GUIDED")
    sky.wait(0.4)
    sky.pilot_sets(LOITER)
    sky.wait(3)
    sky.we_hear = lambda message: True
    sky.end(heard, 30)
    assert sky.vehicle.autopilot.mode == LOITER
    assert (heard[-1].state, heard[-1].cause) == ("failed", "pilot")


def test_an_operators_order_that_is_not_acknowledged_is_given_again_whoever_has_the_vehicle(sky: Sky) -> None:
    sky.flying(20)
    sky.we_hear = unheard
    sky.hears_us = lambda message: False
    ordered = sky.bridge.action_server.order("land", by_operator("land"), block=True, insist=True)
    sky.wait(0.4)
    sky.pilot_sets(ALT_HOLD)
    sky.hears_us = lambda message: True
    sky.wait(3)
    sky.we_hear = lambda message: True
    sky.forward(lambda: ordered.over, "the order", 10)
    assert mode(sky) == "LAND"


def station_targets(sky: Sky, latitude: float, longitude: float, altitude: float) -> None:
    """Another ground station sends the vehicle to a place (AMSL), in the mode in which agents fly it."""
    place = (round(latitude * 1e7), round(longitude * 1e7))
    flags = dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
    number, frame = dialect.MAV_CMD_DO_REPOSITION, dialect.MAV_FRAME_GLOBAL_INT
    message = dialect.MAVLink_command_int_message(1, 1, frame, number, 0, 0, -1, flags, 0, math.nan, *place, altitude)
    sky.downlink.extend(sky.vehicle.receive(message))


@pytest.mark.parametrize(("vehicle", "autopilot"), ALL)
def test_a_way_on_which_another_station_sends_the_vehicle_elsewhere_has_failed(
    tmp_path: Path, vehicle: str, autopilot: str
) -> None:
    sky = sky_of(tmp_path, vehicle, autopilot)
    under_way(sky, vehicle)
    station_targets(sky, HOME.lat, HOME.lon + 0.01, HOME.alt + 40)
    sky.forward(lambda: sky.statuses[-1].final, "the end", 5)
    assert (sky.statuses[-1].state, sky.statuses[-1].cause) == ("failed", "pilot")
    assert sky.statuses[-1].reason.startswith("the vehicle has taken another target")
    sent = len(sky.sent)
    sky.wait(5)
    assert not {one.get_type() for one in sky.sent[sent:]} & {"COMMAND_INT", "SET_POSITION_TARGET_GLOBAL_INT"}


def test_a_way_on_which_the_vehicle_comes_no_nearer_has_failed_though_its_target_is_not_known(sky: Sky) -> None:
    sky.flying(20)
    sky.begin("goto", *FAR, 20)
    sky.wait(3)
    sky.we_hear = lambda message: message.get_type() != "POSITION_TARGET_GLOBAL_INT"
    station_targets(sky, HOME.lat, HOME.lon, HOME.alt + 20)
    sky.forward(lambda: sky.statuses[-1].final, "the end", 70)
    assert sky.statuses[-1].reason.startswith("the vehicle has come no nearer for 60 s")


@pytest.mark.parametrize("asked", ["goto", "takeoff"])
def test_a_motion_of_a_vehicle_that_reports_no_place_any_more_fails_before_its_deadline(sky: Sky, asked: str) -> None:
    sky.armed()
    if asked == "goto":
        sky.done("takeoff", 20)
    heard = sky.begin(asked, *([*FAR, 20] if asked == "goto" else [100]))
    sky.wait(3)
    sky.we_hear = lambda message: message.get_type() != "GLOBAL_POSITION_INT"
    status = sky.end(heard, 35)
    assert (status.state, status.cause) == ("failed", "link")
    assert status.reason.startswith("the vehicle has not reported its position for 30 s")


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_plane_that_circles_while_it_climbs_comes_nearer(
    tmp_path: Path, autopilot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrival, "NO_NEARER_FOR", (15.0, 5.0))
    sky = sky_of(tmp_path, "plane", autopilot)
    sky.armed().done("takeoff", 40)
    sky.done("goto", *NORTH, 120)


def test_a_pause_does_not_wait_for_a_heartbeat_that_is_late(sky: Sky) -> None:
    sky.flying(20)
    sky.begin("goto", *FAR, 20)
    sky.we_hear = lambda message: message.get_type() != "HEARTBEAT"
    sky.wait(2.5)
    sky.bridge.action_server.pause()
    sky.wait(0.2)
    assert sky.vehicle.autopilot.mode.name == "BRAKE"


@pytest.mark.parametrize("silence", [0, 8])
def test_a_mode_of_others_is_theirs_though_we_had_asked_for_it_before_they_took_over(sky: Sky, silence: float) -> None:
    sky.flying(20)
    sky.begin("return_to_launch")
    sky.forward(lambda: sky.belief("state") == ("RTL", True, True), "the way home", 3)
    sky.pilot_sets(LOITER)
    sky.forward(lambda: sky.belief("override") == ("LOITER",), "the override", 5)
    sky.we_hear = lambda message: not silence
    sky.wait(silence)
    sends_home(sky)
    sky.we_hear = lambda message: True
    sky.wait(3)
    assert sky.driver.overridden == "RTL"
    assert sky.belief("override") == ("RTL",)
