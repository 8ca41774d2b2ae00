"""A PX4 is flown by the manifest that flies an ArduCopter, and each danger that it once was is gone: real bytes."""

import math
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.bridge.safety_orders import Step, by_operator
from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.autopilots.px4 import Px4
from bridged.drivers.mavlink.transport.further_messages import Event
from bridged.drivers.mavlink.vehicle.flight_modes import PX4_COPTER, PX4_OFFBOARD
from bridged.drivers.mavlink.vehicle.px4_events import ACTS, event_of
from bridged.drivers.mavlink.vehicle.state import Place
from bridged.drivers.mavlink.vehicle.state import Vehicle as Copter
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.motion.tasks import Landed
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.bridge.test_pause import pause, resume
from tests.bridged.bridge.test_safety_orders import leaving, passing
from tests.bridged.sky import GOAL, HOME, MISSION, Message, Sky

MANUAL, ALTCTL, POSCTL, AUTO = 1, 2, 3, 4
TAKEOFF, LOITER, MISSION_MODE, RTL, LAND = 2, 3, 4, 5, 6
FLIGHT = [["takeoff", 0, 0, 15], [-27.6036, -48.5182, 20], [-27.6038, -48.5184, 20], ["rtl"]]


def px4(tmp_path: Path, robot: str = "", **settings: float) -> Sky:
    """A PX4 copter that has just been switched on. `robot`: further lines of the robot in the mission."""
    vehicle = Vehicle(HOME, KINDS["copter", "px4"], parameters=settings.items())
    return Sky(tmp_path, vehicle=vehicle, mission=MISSION + robot)


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    return px4(tmp_path)


def station(sky: Sky, main: int, sub: int = 0) -> None:
    """Another station sets a mode."""
    request = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_DO_SET_MODE, 0, 1, main, sub, 0, 0, 0, 0)
    sky.downlink.extend(sky.vehicle.receive(request))


def mode(sky: Sky) -> str:
    state = sky.belief("state")
    return str(state[0])


def altitude(sky: Sky) -> float:
    found = sky.belief("altitude")
    return found[0]


def speed(sky: Sky) -> float:
    found = sky.belief("velocity")
    return math.hypot(*found)  # type: ignore[arg-type]


def modes_seen(sky: Sky) -> set[int]:
    """custom_mode of all HEARTBEATs of the vehicle from now on."""
    seen: set[int] = set()

    def look(message: Message) -> bool:
        if message.get_type() == "HEARTBEAT":
            seen.add(message.custom_mode)
        return True

    sky.we_hear = look
    return seen


def test_what_is_asked_of_it_before_it_is_heard_is_asked_in_its_own_terms(sky: Sky) -> None:
    seen = modes_seen(sky)
    sky.done("set_mode", "GUIDED")
    assert seen == {PX4_COPTER.guided}, "ArduCopter's GUIDED, 4, would be AUTO.MISSION"
    assert mode(sky) == "GUIDED"


def test_an_order_that_is_given_before_it_is_heard_is_given_in_its_own_terms(sky: Sky) -> None:
    station(sky, POSCTL)
    execution = sky.driver.order("rtl", by_operator("rtl"), insist=True)
    sky.forward(lambda: execution.over, "the order", 20)
    assert not [one for one in sky.commands(dialect.MAV_CMD_DO_SET_MODE) if one.param2 != AUTO]


def test_it_flies_by_the_actions_of_a_copter_and_altitudes_count_from_home(sky: Sky) -> None:
    sky.flying(15)
    assert altitude(sky) == pytest.approx(15, abs=1.1)
    sky.done("goto", *GOAL)
    assert altitude(sky) == pytest.approx(GOAL[2], abs=1.1)
    sky.done("setpoint", -27.603683, -48.5182, 20)
    sky.done("reposition", -27.603683, -48.5182, 32)
    sky.forward(lambda: abs(altitude(sky) - 32) < 1, "32 m above home", 30)
    sky.done("move", 10.0, 5.0, 12.0)
    assert altitude(sky) == pytest.approx(12, abs=1.1)
    sky.done("land")
    assert mode(sky) == "GUIDED", "PX4 rests in AUTO.LOITER"
    assert sky.belief("override") is None
    assert sky.driver.notes() == []


def test_landing_and_returning_are_no_overrides_and_the_next_flight_begins(sky: Sky) -> None:
    sky.flying(10)
    sky.done("return_to_launch")
    sky.flying(10)
    sky.done("land")
    sky.done("arm_motors", True)
    assert sky.belief("override") is None


@pytest.mark.parametrize("action", ["return_to_launch", "land"])
def test_a_return_that_is_asked_for_as_the_motors_stop_at_home_is_one(sky: Sky, action: str) -> None:
    sky.flying(5)
    sky.begin(action)
    autopilot = sky.vehicle.autopilot
    sky.forward(lambda: autopilot.flight.landed is Landed.ON_GROUND, "the landing", 60)
    sky.wait(1.5)
    assert autopilot.armed
    sky.done(action)
    assert not autopilot.armed


def test_an_order_that_is_given_as_the_motors_stop_is_carried_out(sky: Sky) -> None:
    sky.flying(5)
    sky.begin("land")
    sky.forward(lambda: sky.vehicle.autopilot.flight.landed is Landed.ON_GROUND, "the landing", 60)
    sky.we_hear = lambda message: message.get_type() != "EXTENDED_SYS_STATE"
    sky.driver.vehicle.landed_state = dialect.MAV_LANDED_STATE_LANDING
    sky.wait(1.5)
    execution = sky.bridge.action_server.order("rtl", by_operator("rtl"), block=True, insist=True)
    sky.forward(lambda: execution.over, "the order", 15)
    assert execution.outcome == Outcome("succeeded", "the vehicle is not armed")


def test_a_takeoff_is_refused_disarmed_where_px4_would_begin_it_whenever_somebody_arms(sky: Sky) -> None:
    sky.wait(10)
    final = sky.do("takeoff", 10)
    assert (final.state, final.reason) == (
        "refused", "a takeoff begins armed; the vehicle is not armed, on the ground, in GUIDED",
    )  # fmt: skip
    assert not sky.commands(dialect.MAV_CMD_NAV_TAKEOFF)


@pytest.mark.parametrize("sub", [TAKEOFF, MISSION_MODE])
def test_it_is_not_armed_in_a_mode_in_which_that_begins_a_flight(sky: Sky, sub: int) -> None:
    sky.wait(10)
    station(sky, AUTO, sub)
    sky.wait(2)
    final = sky.do("arm_motors", True)
    assert final.state == "refused"
    assert "would move by itself" in final.reason
    assert not sky.vehicle.autopilot.armed


def test_a_velocity_is_streamed_in_offboard_and_ended_on_purpose(sky: Sky) -> None:
    sky.flying(15)
    seen = modes_seen(sky)
    sky.done("fly", 2.0, 0.0, 0.0)
    sky.wait(1)
    assert speed(sky) == pytest.approx(2, abs=0.5)  # the recorded one flew 1.4 m/s after a second, and 1.6 after three
    assert mode(sky) == "GUIDED", "it obeys agents"
    sky.done("fly", 0.0, 2.0, 0.5)
    sky.wait(5)
    assert speed(sky) < 0.3
    sky.wait(5)
    assert seen == {PX4_COPTER.guided, PX4_OFFBOARD}, "the end of the stream is no failsafe"
    assert sky.belief("override") is None


def test_it_flies_a_circle_around_a_place_until_a_target_ends_it(tmp_path: Path) -> None:
    sky = px4(tmp_path, "    limits: {radius: 120}\n").flying(15)
    assert sky.do("orbit", GOAL[0], GOAL[1], 20, 90, 4).cause == "limits"
    sky.done("orbit", GOAL[0], GOAL[1], 20, 20, 4)
    sky.wait(25)
    found = sky.driver.vehicle.position
    assert found.distance(Place(GOAL[0], GOAL[1], 20)) == pytest.approx(20, abs=3)
    assert (mode(sky), sky.belief("override")) == ("GUIDED", None)
    sky.done("goto", *GOAL)


def test_a_target_after_a_velocity_ends_the_stream_and_not_the_target(sky: Sky) -> None:
    sky.flying(15)
    sky.done("fly", 2.0, 0.0, 0.0)
    sky.done("goto", *GOAL)
    sent = len(sky.sent)
    sky.wait(5)
    assert "SET_POSITION_TARGET_LOCAL_NED" not in {one.get_type() for one in sky.sent[sent:]}


def test_lost_setpoints_are_its_failsafe_and_it_is_not_pulled_back_into_offboard(sky: Sky) -> None:
    sky.flying(15)
    sky.done("fly", 2.0, 0.0, 0.0)
    sky.hears_us = lambda message: False
    sky.forward(lambda: mode(sky) == "RTL", "the failsafe", 10)
    sky.hears_us = lambda message: True
    sky.wait(5)
    assert mode(sky) == "RTL"
    assert sky.belief("override") == ("RTL",)


def test_a_velocity_ends_in_time_though_the_vehicle_is_not_heard_and_its_failsafe_has_it_when_the_link_is_lost(
    sky: Sky,
) -> None:
    sky.flying(15)
    sky.done("fly", 2.0, 0.0, 0.0)
    sky.we_hear = lambda message: False
    sky.wait(4.5)
    assert math.hypot(sky.vehicle.autopilot.motion.velocity.north, sky.vehicle.autopilot.motion.velocity.east) < 0.3
    sky.wait(5)
    assert sky.vehicle.autopilot.mode.name == "RTL"


def test_a_motion_that_is_cancelled_or_late_holds_and_never_flies_the_stored_mission(sky: Sky) -> None:
    sky.done("upload_mission", FLIGHT)
    sky.flying(20)
    seen = modes_seen(sky)
    heard = sky.begin("goto", -27.6020, -48.5180, 30)
    sky.wait(4)
    sky.bridge.action_server.cancel("uav", heard[0].id)
    sky.forward(lambda: speed(sky) < 0.3, "it stands still", 8)
    assert sky.do("goto", -27.5900, -48.5180, 30, deadline=3.0).state == "timed_out"
    sky.wait(6)
    assert speed(sky) < 0.3
    assert altitude(sky) == pytest.approx(25, abs=6)
    assert seen == {PX4_COPTER.guided}


def test_a_stations_mode_is_an_override_and_a_pilots_hold_hands_nothing_over(sky: Sky) -> None:
    sky.flying(20)
    heard = sky.begin("goto", -27.6020, -48.5180, 30)
    sky.wait(3)
    station(sky, AUTO, RTL)
    sky.wait(3)
    assert heard[-1].reason.startswith("the mode became RTL"), "not by its target, which shows earlier"
    assert heard[-1].cause == "pilot"
    assert sky.belief("override") == ("RTL",)
    station(sky, AUTO, LOITER)
    sky.wait(3)
    assert mode(sky) == "HOLD"
    assert sky.do("goto", *GOAL).cause == "pilot"
    sky.done("set_mode", "GUIDED")
    sky.done("goto", *GOAL)


def test_a_bridge_that_is_started_again_during_a_takeoff_has_the_vehicle(tmp_path: Path) -> None:
    before = px4(tmp_path / "before")
    before.wait(10)
    before.done("arm_motors", True)
    before.begin("takeoff", 30)
    before.forward(lambda: altitude(before) > 5, "5 m", 20)
    after = Sky(tmp_path / "after", vehicle=before.vehicle)
    after.wait(3)
    assert mode(after) == "GUIDED", "as an ArduCopter's, that takes off in GUIDED"
    assert after.belief("override") is None
    after.done("return_to_launch")


def test_a_takeoff_whose_end_is_seen_late_is_judged_by_a_position_after_it(sky: Sky) -> None:
    sky.wait(10)
    sky.done("arm_motors", True)
    heard = sky.begin("takeoff", 10)
    sky.forward(lambda: altitude(sky) > 4, "4 m", 20)
    sky.we_hear = lambda message: message.get_type() != "GLOBAL_POSITION_INT"
    sky.forward(lambda: sky.driver.vehicle.mode == PX4_COPTER.guided, "the end of the takeoff", 20)
    sky.wait(2)
    assert not heard[-1].final
    assert mode(sky) == "GUIDED", "it is not yet known whether others have ended it"
    sky.we_hear = lambda message: True
    sky.wait(1)
    assert heard[-1].state == "succeeded"
    assert mode(sky) == "GUIDED"


def test_a_takeoff_to_below_is_refused_where_px4_would_acknowledge_it_and_stay(sky: Sky) -> None:
    sky.flying(20)
    status = sky.do("takeoff", 10)
    assert status.state == "refused"
    assert status.reason.startswith("a takeoff to 10 m does not lead down from 19.")
    assert sky.commands(dialect.MAV_CMD_NAV_TAKEOFF)[-1].param7 > 30, "it was not sent"


def test_a_takeoff_that_others_end_has_failed(sky: Sky) -> None:
    sky.wait(10)
    sky.done("arm_motors", True)
    heard = sky.begin("takeoff", 30)
    sky.forward(lambda: altitude(sky) > 5, "5 m", 20)
    station(sky, AUTO, LOITER)
    sky.wait(4)
    assert (heard[-1].state, heard[-1].cause) == ("failed", "pilot")
    assert mode(sky) == "HOLD"


async def test_what_an_operator_pauses_goes_on(tmp_path: Path) -> None:
    sky = px4(tmp_path)
    sky.armed()
    climbing = sky.begin("takeoff", 20)
    sky.forward(lambda: altitude(sky) > 6, "6 m", 20)
    assert (await pause(sky)).state == "succeeded"
    await passing(sky, 20)
    assert altitude(sky) < 12
    assert (await resume(sky)).state == "succeeded"
    assert sky.end(climbing).state == "succeeded"
    going = sky.begin("goto", -27.6020, -48.5180, 30)
    await passing(sky, 4)
    await pause(sky)
    await passing(sky, 10)
    assert speed(sky) < 0.3
    await resume(sky)
    assert sky.end(going).state == "succeeded"
    sky.done("fly", 2.0, 0.0, 0.0)
    await pause(sky)
    assert (await resume(sky)).state == "succeeded"
    assert sky.belief("override") is None


def test_sticks_of_a_pilot_take_it(sky: Sky) -> None:
    sky.flying(20)
    heard = sky.begin("goto", -27.6020, -48.5180, 30)
    sky.wait(2)
    for push in (0, 0, 600, 900, 900, 900, 900):
        sky.downlink.extend(sky.vehicle.receive(dialect.MAVLink_manual_control_message(1, push, 0, 500, 0, 0)))
        sky.wait(0.2)
    sky.wait(1.5)
    assert heard[-1].cause == "pilot"
    assert sky.told("override")[0] == ("POSCTL",)
    assert sky.belief("override") == ("HOLD",), "his sticks fell silent, which is a failsafe"


def test_a_lost_link_ends_its_actions_and_its_own_failsafe_is_told(tmp_path: Path) -> None:
    sky = px4(tmp_path, "    failsafe: {gcs: bridge}\n", NAV_DLL_ACT=2).flying(20)
    heard = sky.begin("goto", -27.5900, -48.5180, 30)
    sky.wait(3)
    sky.hears_us = sky.we_hear = lambda message: False
    sky.wait(30)
    assert heard[-1].cause == "link"
    sky.hears_us = sky.we_hear = lambda message: True
    sky.wait(3)
    assert mode(sky) == "RTL"
    assert sky.belief("override") == ("RTL",)


def deaf_to_beats(tmp_path: Path) -> Sky:
    """A PX4 on its way that hears no ground station any more, until its failsafe holds it."""
    sky = px4(tmp_path, "    failsafe: {gcs: bridge}\n", NAV_DLL_ACT=2).flying(20)
    sky.begin("goto", -27.5900, -48.5180, 30)
    sky.wait(3)
    sky.hears_us = lambda message: message.get_type() != "HEARTBEAT"
    sky.forward(lambda: sky.driver.vehicle.system_status == dialect.MAV_STATE_CRITICAL, "its failsafe", 20)
    return sky


def test_its_failsafe_that_holds_in_the_mode_of_agents_is_not_undone_by_them(tmp_path: Path) -> None:
    sky = deaf_to_beats(tmp_path)
    assert sky.driver.vehicle.mode == PX4_COPTER.guided
    sky.wait(2.5)
    reason = "the mode became HOLD, which nobody here asked for (the vehicle's failsafe)"
    assert (sky.statuses[-1].state, sky.statuses[-1].cause) == ("failed", "pilot")
    assert sky.statuses[-1].reason.startswith(reason)
    assert sky.belief("override") == ("HOLD",)
    assert sky.do("goto", *GOAL).cause == "pilot"
    sky.wait(6)
    assert mode(sky) == "RTL"
    assert sky.belief("override") == ("RTL",), "the mode that they have set, not the first one"
    assert "others have set RTL" in sky.do("goto", *GOAL).reason


def test_its_fence_that_holds_it_in_the_mode_of_agents_ends_their_motion_and_is_not_undone(tmp_path: Path) -> None:
    sky = px4(tmp_path, GF_ACTION=2).flying(20)
    heard = sky.begin("goto", -27.5900, -48.5180, 30)
    sky.wait(3)
    sky.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 20)
    status = sky.end(heard, 10)
    assert (status.state, status.cause) == ("failed", "pilot")
    assert "HOLD, which nobody here asked for (the vehicle's failsafe)" in status.reason
    assert sky.belief("override") == ("HOLD",)
    sky.wait(6)
    assert speed(sky) < 0.5
    assert sky.do("goto", *GOAL).cause == "pilot"


def test_a_place_in_metres_is_no_target_while_where_on_earth_it_flies_is_not_known(sky: Sky) -> None:
    sky.flying(20)
    sky.we_hear = lambda message: message.get_type() != "GLOBAL_POSITION_INT"
    sky.wait(7)
    assert sky.do("move", 20.0, 0.0, 20.0).state == "refused"


def leaves_fence(tmp_path: Path, action: int) -> Sky:
    """A PX4 whose fence is about to shrink, just after a HEARTBEAT. `action`: GF_ACTION."""
    sky = px4(tmp_path, GF_ACTION=action).flying(20)
    sky.done("goto", *GOAL)
    sky.forward(lambda: sky.driver.flight.now == sky.driver.vehicle.heard_at, "a HEARTBEAT", 2)
    return sky


def shrinks(sky: Sky) -> None:
    sky.vehicle.autopilot.parameters.set("GF_MAX_HOR_DIST", 20)
    sky.forward(lambda: sky.vehicle.autopilot.failsafes.acting, "the failsafe", 1)  # type: ignore[attr-defined]
    sky.wait(0.1)
    assert sky.driver.vehicle.system_status == dialect.MAV_STATE_ACTIVE


@pytest.mark.parametrize("asked", ["setpoint", "fly", "order"])
def test_what_an_agent_asks_before_the_heartbeat_that_shows_a_failsafe_does_not_end_it(
    tmp_path: Path, asked: str
) -> None:
    sky = leaves_fence(tmp_path, 3)
    shrinks(sky)
    if asked == "order":
        ended = sky.bridge.action_server.order("hold", Outcome("failed", "lost"), block=False, insist=False)
        sky.forward(lambda: ended.outcome, "the end of the order", 3)
        assert ended.outcome == Outcome("failed", "the mode became HOLD, which nobody here asked for", "pilot")
    else:
        status = sky.do(asked, *((HOME.lat, HOME.lon, 20) if asked == "setpoint" else (1.0, 0.0, 0.0)))
        assert (status.state, status.cause) == ("failed", "pilot")
    sky.forward(lambda: mode(sky) == "RTL", "the way home", 8)


async def test_a_pause_before_the_heartbeat_that_shows_a_failsafe_does_not_end_it_and_the_next_does(
    tmp_path: Path,
) -> None:
    sky = leaves_fence(tmp_path, 3)
    shrinks(sky)
    outcome = await pause(sky)
    assert (outcome.state, outcome.cause) == ("failed", "pilot")
    await passing(sky, 8)
    assert mode(sky) == "RTL"
    assert not sky.bridge.action_server.paused
    assert (await pause(sky)).state == "succeeded"
    await passing(sky, 5)
    assert mode(sky) == "GUIDED"


def test_a_mode_that_an_agent_was_setting_as_a_failsafe_began_to_hold_in_it_is_the_failsafes(tmp_path: Path) -> None:
    sky = leaves_fence(tmp_path, 2)
    heard = sky.begin("set_mode", "GUIDED")
    sky.wait(0.1)
    shrinks(sky)
    sky.end(heard, 5)
    assert (heard[-1].state, heard[-1].cause) == ("failed", "pilot")
    sky.forward(lambda: sky.belief("override") == ("HOLD",), "the override", 3)
    sky.done("set_mode", "GUIDED")
    assert sky.belief("override") is None


def test_a_failsafe_that_is_reported_in_the_moment_of_a_heartbeat_is_shown_by_the_next() -> None:
    vehicle = Copter(PX4_COPTER)
    beat = dialect.MAVLink_heartbeat_message(2, dialect.MAV_AUTOPILOT_PX4, 157, PX4_COPTER.guided, 4, 3)
    vehicle.receive(beat, 1.0)
    vehicle.receive(Event(min(ACTS), 1000, 1, 0, 0, 0x42, [0, 0, 4, 3, 5, *[0] * 35]), 1.0)
    assert vehicle.failsafe_announced
    vehicle.receive(beat, 2.0)
    assert not vehicle.failsafe_announced


@pytest.mark.parametrize(("does", "said"), [(5, "holds"), (6, "returns"), (7, "lands"), (8, "descends")])
@pytest.mark.parametrize("number", sorted(ACTS))
def test_an_event_of_a_failsafe_says_what_the_vehicle_does(number: int, does: int, said: str) -> None:
    message = Event(number, 1000, 1, 0, 0, 0x42, [0, 0, 4, 3, does, *[0] * 35])
    event = event_of(message)
    assert event is not None
    assert event.text == f"a failsafe acts: the vehicle {said}"


def test_a_takeoff_that_its_failsafe_ends_has_failed(tmp_path: Path) -> None:
    sky = px4(tmp_path, "    failsafe: {gcs: bridge}\n", NAV_DLL_ACT=2)
    sky.wait(10)
    sky.done("arm_motors", True)
    heard = sky.begin("takeoff", 30)
    sky.hears_us = lambda message: message.get_type() != "HEARTBEAT"
    sky.end(heard, 25)
    assert (heard[-1].state, heard[-1].cause) == ("failed", "pilot")
    assert "(the vehicle's failsafe)" in heard[-1].reason
    assert sky.do("goto", *GOAL).cause == "pilot"


def test_an_agent_takes_control_again_from_its_failsafe(tmp_path: Path) -> None:
    sky = deaf_to_beats(tmp_path)
    sky.wait(2.5)
    sky.done("set_mode", "GUIDED")
    assert sky.belief("override") is None
    sky.done("goto", *GOAL)


def test_a_bridge_that_is_started_while_its_failsafe_acts_does_not_undo_it(tmp_path: Path) -> None:
    before = deaf_to_beats(tmp_path / "before")
    before.forward(lambda: before.driver.vehicle.mode == PX4_COPTER.rtl, "the way home", 10)
    after = Sky(tmp_path / "after", vehicle=before.vehicle)
    after.wait(3)
    assert after.belief("override") == ("RTL",)
    assert after.do("goto", *GOAL).cause == "pilot"


def warned(sky: Sky) -> Sky:
    """Its HEARTBEATs have the state CRITICAL for something that it warns of and does not act on."""

    def critical(message: Message) -> bool:
        if message.get_type() == "HEARTBEAT":
            message.system_status = dialect.MAV_STATE_CRITICAL
        return True

    sky.we_hear = critical
    return sky


def test_what_it_only_warns_of_leaves_it_to_its_agents(tmp_path: Path) -> None:
    sky = px4(tmp_path)
    sky.wait(10)
    sky.done("arm_motors", True)
    warned(sky).wait(3)
    sky.done("takeoff", 20)
    sky.done("goto", *GOAL)
    assert sky.belief("override") is None
    sky.done("return_to_launch")


async def test_what_it_only_warns_of_keeps_no_order_from_it(tmp_path: Path) -> None:
    sky = warned(px4(tmp_path / "lost").flying(20))
    sky.bridge.orders.agent_lost("uav", "killed", (Step("hold", 3.0), Step("rtl")))
    await passing(sky, 15)
    assert mode(sky) == "RTL"
    sky = warned(px4(tmp_path / "left").flying(20))
    await passing(sky, 3)
    left = await leaving(sky, sky.bridge.orders.shut_down("rtl"))
    assert (left.state, left.order) == ("ordered", "rtl")


@pytest.mark.parametrize("silence", [0.0, 20.0])
def test_a_pilots_mode_that_shows_with_motors_that_have_stopped_is_the_pilots(tmp_path: Path, silence: float) -> None:
    sky = px4(tmp_path).flying(2)

    def by_force(arm: int) -> None:
        parameters = (arm, 21196, 0, 0, 0, 0, 0)
        request = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, *parameters)
        sky.downlink.extend(sky.vehicle.receive(request))

    beats = sky.driver.vehicle.heartbeats
    sky.forward(lambda: sky.driver.vehicle.heartbeats > beats, "a HEARTBEAT")
    sky.we_hear = sky.hears_us = lambda message: not silence
    sky.wait(silence)
    by_force(0)
    station(sky, POSCTL)
    sky.wait(3)
    sky.we_hear = sky.hears_us = lambda message: True
    sky.wait(6)
    by_force(1)
    sky.wait(4)
    assert sky.driver.overridden == "POSCTL"
    assert sky.belief("override") == ("POSCTL",)


def test_the_bridge_is_its_ground_station_and_says_if_its_failsafe_is_off(tmp_path: Path) -> None:
    sky = px4(tmp_path, "    failsafe: {gcs: bridge}\n")
    sky.wait(10)
    assert {one.type for one in sky.sent if one.get_type() == "HEARTBEAT"} == {dialect.MAV_TYPE_GCS}
    assert [(note.code, note.text) for note in sky.driver.notes()] == [
        ("failsafe_off", "failsafe: NAV_DLL_ACT is 0 on the vehicle: its ground-station failsafe is off")
    ]


def test_a_human_ground_station_is_not_hidden_and_texts_that_miss_are_noted(tmp_path: Path) -> None:
    sky = px4(tmp_path, "    failsafe: {gcs: human}\n", NAV_DLL_ACT=2)
    sky.wait(10)
    assert {one.type for one in sky.sent if one.get_type() == "HEARTBEAT"} == {dialect.MAV_TYPE_ONBOARD_CONTROLLER}
    assert [note.code for note in sky.driver.notes()] == ["texts_missing"]


def test_its_words_reach_a_refusal(sky: Sky) -> None:
    sky.flying(10)
    final = sky.do("set_mode", "OFFBOARD")
    assert final.state == "refused"
    assert "Switching to Offboard is currently not available" in final.reason


@pytest.mark.parametrize(("forward", "stopped"), [("", True), ("    forward: udpout:127.0.0.1:9\n", False)])
def test_its_fast_streams_stop_unless_a_ground_station_hears_them(tmp_path: Path, forward: str, stopped: bool) -> None:
    sky = px4(tmp_path, forward)
    sky.wait(5)
    asked = {int(one.param1): one.param2 for one in sky.commands(dialect.MAV_CMD_SET_MESSAGE_INTERVAL)}
    assert (asked.get(dialect.MAVLINK_MSG_ID_HIGHRES_IMU) == -1) is stopped
    assert asked[dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT] > 0


@pytest.mark.parametrize(
    ("robot", "settings", "hindrance", "why"),
    [
        ("", {}, "Compass 0 fault", "Compass 0 fault"),
        ("    failsafe: {gcs: human}\n", {"NAV_DLL_ACT": 2.0}, "", "no ground station is heard"),
    ],
    ids=["text", "event"],
)
def test_an_arming_that_waits_tells_for_what_the_vehicle_waits(
    tmp_path: Path, robot: str, settings: dict[str, float], hindrance: str, why: str
) -> None:
    sky = px4(tmp_path, robot, **settings)
    sky.wait(5)
    sky.vehicle.autopilot.hindrance = hindrance
    sky.wait(3)
    heard = sky.begin("arm_motors", True, deadline=20.0)
    sky.end(heard, 40)
    assert (heard[-1].state, why in heard[-1].reason) == ("timed_out", True), heard[-1].reason


def test_integers_and_unknown_names_of_parameters(sky: Sky) -> None:
    sky.wait(5)
    sky.done("set_param", "GF_ACTION", 3.0)
    sky.done("get_param", "GF_ACTION")
    assert sky.belief("parameter") == ("GF_ACTION", 3.0)
    assert sky.do("set_param", "GF_ACTION", 2.5).reason == "GF_ACTION is a whole number on the vehicle, got 2.5"
    sky.done("set_param", "RTL_RETURN_ALT", 25.5)
    before = sky.clock.time
    assert sky.do("get_param", "NO_SUCH").reason == "the vehicle knows no parameter NO_SUCH"
    assert sky.clock.time - before < 1, "PX4 answers at once"


def test_the_fence_of_a_copters_manifest(sky: Sky) -> None:
    sky.wait(5)
    sky.done("fence_radius", 300.0)
    sky.done("enable_fence", False)
    sky.done("enable_fence", True)
    sky.done("get_param", "GF_ACTION")
    present = sky.beliefs("parameter")
    assert sorted(present) == [("FENCE_RADIUS", 300.0), ("GF_ACTION", 2.0)]


FIELD = [[-27.6050, -48.5195], [-27.6050, -48.5170], [-27.6025, -48.5170], [-27.6025, -48.5195]]


def test_a_fence_of_corners_is_stored_and_keeps_targets_in(sky: Sky) -> None:
    sky.wait(5)
    assert sky.do("upload_fence", [[1, 2], [3, 4]]).state == "refused"
    assert sky.do("upload_fence", [[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]]).reason == "home is outside of the fence"
    sky.done("upload_fence", FIELD)
    sky.flying(15)
    final = sky.do("goto", -27.6000, -48.5184, 20)
    assert final.state == "refused"
    assert "outside geofence" in final.reason
    sky.done("goto", *GOAL)


def test_every_message_that_numbers_or_counts_items_is_renumbered_in_both_directions() -> None:
    numbering = {
        kind.msgname
        for kind in dialect.mavlink_map.values()
        if kind.msgname.startswith("MISSION_") and {"seq", "count"} & set(kind.fieldnames)
    }
    assert {"MISSION_REQUEST", "MISSION_REQUEST_INT"} <= numbering, "an autopilot may ask by either"
    assert numbering <= Px4.incoming.keys() & Px4.outgoing.keys()


def test_the_item_that_a_jump_leads_to_is_renumbered_in_both_directions() -> None:
    jump = dialect.MAVLink_mission_item_int_message(1, 1, 3, 2, dialect.MAV_CMD_DO_JUMP, 0, 1, 2.0, 5.0, 0, 0, 0, 0, 0)
    Px4.outgoing["MISSION_ITEM_INT"](jump)
    assert (jump.seq, jump.param1, jump.param2, jump.param4) == (2, 1.0, 5.0, 0)
    Px4.incoming["MISSION_ITEM_INT"](jump)
    assert (jump.seq, jump.param1, jump.param2) == (3, 2.0, 5.0)


def test_a_mission_is_stored_without_home_and_flown_to_its_end(sky: Sky) -> None:
    sky.wait(5)
    sky.done("upload_mission", FLIGHT)
    counts = [one.count for one in sky.sent if one.get_type() == "MISSION_COUNT"]
    assert counts == [len(FLIGHT)]
    sky.done("download_mission")
    sky.wait(2)
    assert sky.belief("mission_item") == (1, len(FLIGHT)), "agents count from 1"
    sky.armed()
    sky.percepts.clear()
    sky.done("start_mission")
    assert sky.belief("state") == ("GUIDED", True, False)
    assert sky.belief("override") is None
    flown = sky.told("item_reached")
    assert len(flown) == len(set(flown)) > 2, "each once, though PX4 repeats them each second"


def test_a_mission_that_cannot_be_flown_is_refused_with_its_reason(sky: Sky) -> None:
    sky.wait(5)
    final = sky.do("upload_mission", [[-27.6036, -48.5182, 20], ["takeoff", 0, 0, 15], ["rtl"]])
    assert final.state == "refused"
    assert "reports that it cannot be flown" in final.reason
    assert "takeoff is not its first item" in final.reason


def test_a_pilots_mode_during_a_mission_ends_it(sky: Sky) -> None:
    sky.wait(5)
    sky.done("upload_mission", FLIGHT)
    sky.armed()
    heard = sky.begin("start_mission")
    sky.forward(lambda: altitude(sky) > 10, "10 m", 30)
    station(sky, AUTO, LOITER)
    sky.wait(8)
    assert heard[-1].state == "failed"
    assert "nobody here asked for" in heard[-1].reason
