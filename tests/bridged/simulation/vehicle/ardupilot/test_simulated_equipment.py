"""Servos, gripper, battery, sticks and signatures of the simulated copter; virtual time, real MAVLink bytes."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.drivers.mavlink.transport.signing import MINUTE, Signing, key_of, now_10us
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.ardupilot.parameters import COPTER
from bridged.simulation.vehicle.autopilot import ChargeState
from bridged.simulation.vehicle.fault_injection import Faults
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Landed
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.sky import HOME
from tests.bridged.virtual_copter import Station

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
SET_SERVO, REPEAT_SERVO, GRIPPER, REQUEST = 183, 184, 211, 512
KEEP = 65535


def last(station: Station, message_id: int) -> dialect.MAVLink_message:
    assert station.command(REQUEST, message_id) == ACCEPTED
    return station.heard[-1]


def pulse(station: Station, channel: int) -> int:
    value: int = getattr(last(station, 36), f"servo{channel}_raw")
    return value


def set_parameter(station: Station, name: str, value: float) -> None:
    (answer,) = station.say(dialect.MAVLink_param_set_message(1, 1, name.encode(), value, 9))
    assert answer.param_value == pytest.approx(value)


@pytest.mark.parametrize(
    ("channel", "said"), [(1, ["ServoRelayEvent: Channel 1 is already in use"]), (0, ["No servo output 0"]), (17, None)]
)
def test_a_servo_output_of_a_motor_or_none_is_refused(station: Station, channel: int, said: list[str] | None) -> None:
    assert station.command(SET_SERVO, channel, 1900) == FAILED
    assert station.texts() == (said or ["No servo output 17"])
    assert pulse(station, 1) == 1000


def test_a_repeated_servo_goes_to_and_fro_and_ends_at_its_trim() -> None:
    station, seen = Station(), []
    assert station.command(REPEAT_SERVO, 10, 1900, 2, 1.0) == ACCEPTED
    for _ in range(40):
        station.wait(0.1)
        seen.append(pulse(station, 10))
    turns = [one for one, before in zip(seen, [0, *seen], strict=False) if one != before]
    assert turns == [1900, 1500, 1900, 1500]


def test_a_gripper_moves_its_servo_and_tells_when_it_has_let_go(station: Station) -> None:
    assert station.command(GRIPPER, 1, 0) == FAILED  # none is enabled
    set_parameter(station, "GRIP_ENABLE", 1)
    set_parameter(station, "SERVO9_FUNCTION", 28)
    assert station.command(GRIPPER, 1, 1) == ACCEPTED
    assert pulse(station, 9) == 1900
    assert station.command(GRIPPER, 1, 0) == ACCEPTED
    assert pulse(station, 9) == 1100
    station.wait(3.5)
    assert station.texts() == ["Gripper load grabbing", "Gripper load releasing", "Gripper load released"]
    assert station.command(GRIPPER, 1, 2) == DENIED


def drained(minutes: float, **parameters: float) -> Station:
    station = Station()
    set_parameter(station, "SIM_BATT_CAP_AH", 28.12 * minutes / 60)
    set_parameter(station, "BATT_CAPACITY", round(28120 * minutes / 60))
    for name, value in parameters.items():
        set_parameter(station, name, value)
    return station


def test_the_voltage_of_the_recorded_battery_never_falls(station: Station) -> None:
    station.fly_to(5.0)
    station.wait(600.0)
    status = last(station, 147)
    assert (status.voltages[0], status.battery_remaining) == (12600, 0)
    assert station.autopilot.flight.airborne


def test_a_battery_with_a_capacity_loses_voltage_in_flight_and_charges_at_home() -> None:
    station = drained(4)
    full = last(station, 147)
    assert (full.voltages[0], full.battery_remaining, full.charge_state) == (12600, 100, ChargeState.OK)
    station.fly_to(5.0)
    station.wait(90.0)
    used = last(station, 147)
    assert 11_000 < used.voltages[0] < 11_900
    assert 50 < used.battery_remaining < 62
    assert last(station, 1).voltage_battery == used.voltages[0]
    assert station.command(21) == ACCEPTED
    station.until(lambda: not station.autopilot.armed, "landing")
    station.wait(1.0)
    assert last(station, 147).charge_state == ChargeState.CHARGING
    took = station.until(lambda: station.autopilot.battery.remaining == 100, "a full battery")
    assert 45 < took < 75  # about half of it in half of two minutes
    station.wait(1.0)
    assert last(station, 147).voltages[0] == 12600


def test_the_copter_is_not_charged_away_from_home() -> None:
    station = drained(4)
    station.fly_to(5.0)
    station.setpoint(Vector(40.0, 0.0, 5.0))
    station.wait(30.0)
    assert station.command(21) == ACCEPTED
    station.until(lambda: not station.autopilot.armed, "landing")
    left = station.autopilot.battery.remaining
    station.wait(60.0)
    assert station.autopilot.battery.remaining == left < 95


def test_a_low_battery_brings_the_copter_home_if_it_is_told_to() -> None:
    station = drained(4, BATT_LOW_VOLT=11.5, BATT_FS_LOW_ACT=2)
    station.fly_to(5.0)
    station.until(lambda: station.autopilot.mode is Mode.RTL, "return", 300)
    low, failsafe = [text for text in station.texts() if "Battery" in text]
    assert low.startswith("Battery 1 is low 11.")
    assert failsafe == "Battery Failsafe"
    station.until(lambda: not station.autopilot.armed, "landing")
    station.guided()
    assert station.command(400, 1) == FAILED
    assert "Arm: Battery failsafe" in station.texts()
    station.wait(120.0)
    assert station.command(400, 1) == ACCEPTED


def test_a_low_battery_without_an_action_is_told_only() -> None:
    station = drained(4, BATT_LOW_MAH=1500)
    station.fly_to(5.0)
    station.until(lambda: any(text.startswith("Battery 1 is low") for text in station.texts()), "warning", 300)
    assert station.autopilot.mode is Mode.GUIDED
    assert "Battery Failsafe" not in station.texts()


def test_an_empty_battery_lets_the_copter_fall() -> None:
    station = drained(1)
    station.fly_to(20.0)
    station.until(lambda: station.autopilot.flight.landed is Landed.ON_GROUND, "fall", 120)
    assert "SIM battery is empty" in station.texts()
    assert not station.autopilot.armed


def override(station: Station, **pulses: int) -> None:
    channels = [pulses.get(f"chan{number}", KEEP if number <= 8 else 0) for number in range(1, 19)]
    station.say(dialect.MAVLink_rc_channels_override_message(1, 1, *channels))


def test_overridden_channels_show_until_they_are_given_back_or_too_old(station: Station) -> None:
    override(station, chan2=1700, chan10=1234)
    shown = last(station, 65)
    assert (shown.chan1_raw, shown.chan2_raw, shown.chan10_raw, shown.chancount) == (1500, 1700, 1234, 16)
    override(station, chan2=0)
    station.wait(1.0)
    shown = last(station, 65)
    assert (shown.chan2_raw, shown.chan10_raw) == (1500, 1234)
    station.wait(2.5)
    assert last(station, 65).chan10_raw == 0


def test_overrides_of_another_system_than_the_ground_station_are_ignored(station: Station) -> None:
    set_parameter(station, "MAV_GCS_SYSID", 200)
    override(station, chan2=1700)
    assert last(station, 65).chan2_raw == 1500


def test_a_stick_that_is_overridden_moves_the_copter_in_loiter_until_it_is_centred(station: Station) -> None:
    station.fly_to(10.0)
    assert station.command(176, 1, Mode.LOITER) == ACCEPTED
    for _ in range(10):
        override(station, chan2=1300)  # the nose down: forward, which is north
        station.wait(0.5)
    assert station.at.north > 8
    override(station, chan2=1500)
    station.until(lambda: station.speed < 0.1, "a stop", 12)


def test_the_mode_switch_of_an_overridden_transmitter_changes_the_mode(station: Station) -> None:
    override(station, chan5=1400)  # third position: FLTMODE3
    station.wait(0.5)
    assert station.autopilot.mode is Mode.RTL
    station.guided()
    override(station, chan5=1400)
    station.wait(0.5)
    assert station.autopilot.mode is Mode.GUIDED  # it was not moved


def test_the_velocity_that_is_flown_shows_as_the_local_target(station: Station) -> None:
    station.fly_to(10.0)
    station.say(
        dialect.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, 1, 0b110111000111, 0, 0, 0, 2.0, 1.0, -0.5, 0, 0, 0, 0, 0
        )
    )
    station.wait(1.0)
    target = last(station, 85)
    assert (target.vx, target.vy, target.vz, target.type_mask & 0b111) == (2.0, 1.0, -0.5, 0b111)
    station.wait(4.0)
    assert last(station, 85).vx == 0.0
    station.setpoint(Vector(5.0, -3.0, 12.0))
    target = last(station, 85)
    assert (round(target.x, 1), round(target.y, 1), round(target.z, 1)) == (5.0, -3.0, -12.0)
    assert target.type_mask & 0b111 == 0


def test_the_fence_tells_its_state_while_it_is_enabled(station: Station) -> None:
    assert station.command(REQUEST, 162) == FAILED
    assert station.command(207, 1) == ACCEPTED
    assert last(station, 162).breach_status == 0
    station.fly_to(20.0)
    set_parameter(station, "FENCE_ALT_MAX", 10)
    station.wait(0.5)
    status = last(station, 162)
    assert (status.breach_status, status.breach_count, status.breach_type) == (1, 1, 2)
    assert station.command(207, 0) == ACCEPTED


KEY = key_of(b"a passphrase of the field")


def packet(signing: Signing | None, message: dialect.MAVLink_message) -> bytes:
    return Encoder(255, 190).pack(message, signing)


def taken(vehicle: Vehicle, channel: int, data: bytes) -> tuple[int, int]:
    """How many packets the vehicle takes on a channel, and how many it refuses."""
    counters = WireCounters()
    messages = Framer(counters, gate=vehicle.signing_state.gate(channel)).feed(data, datagram=True)
    return len(messages), counters.refused


def test_a_vehicle_with_a_key_takes_signed_packets_only_but_what_radios_add() -> None:
    vehicle = Vehicle(HOME, key=KEY)
    arm = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    signed = packet(Signing(KEY), arm)
    assert taken(vehicle, 0, signed) == (1, 0)
    assert taken(vehicle, 0, signed) == (0, 1)  # once more is a replay
    assert taken(vehicle, 0, packet(None, arm)) == (0, 1)
    assert taken(vehicle, 0, packet(Signing(key_of(b"another")), arm)) == (0, 1)
    assert taken(vehicle, 0, packet(None, dialect.MAVLink_radio_status_message(1, 1, 1, 1, 1, 1, 1))) == (1, 0)


def setup_signing(station: Station, key: bytes, timestamp: int) -> None:
    station.say(dialect.MAVLink_setup_signing_message(1, 1, list(key), timestamp))


def test_a_vehicle_that_gets_a_key_signs_and_keeps_its_first_link_open(station: Station) -> None:
    vehicle = station.vehicle
    assert vehicle.signing_state.signing is None
    ahead = now_10us() + 10 * MINUTE
    setup_signing(station, KEY, ahead)
    assert vehicle.signing_state.signing.timestamps.next() > ahead
    unsigned = packet(None, dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    assert taken(vehicle, 0, unsigned) == (1, 0)
    assert taken(vehicle, 1, unsigned) == (0, 1)
    assert station.command(246, 1) == ACCEPTED
    station.wait(5.0)
    assert vehicle.signing_state.signing is not None
    setup_signing(station, bytes(32), 0)
    assert station.vehicle.signing_state.signing is None


def test_a_key_is_refused_with_motors_on(station: Station) -> None:
    station.guided()
    station.command(400, 1)
    setup_signing(station, KEY, 1)
    assert station.vehicle.signing_state.signing is None
    assert "ERROR: Won't setup signing when armed" in station.texts()


def heard(vehicle: Vehicle, message: dialect.MAVLink_message, channel: int = 0) -> list[dialect.MAVLink_message]:
    (read,) = Framer(WireCounters()).feed(packet(None, message), datagram=True)
    return vehicle.receive(read, channel)


def test_each_link_has_streams_of_its_own_and_hears_what_happens_by_orders_on_another() -> None:
    vehicle = Vehicle(HOME, channels=2)
    vehicle.advance(4.0)
    vehicle.waiting(1)
    heard(vehicle, dialect.MAVLink_command_long_message(1, 1, 511, 0, 33, 100_000, 0, 0, 0, 0, 0))
    first, second = vehicle.advance(2.0), vehicle.waiting(1)
    assert sum(message.get_type() == "GLOBAL_POSITION_INT" for message in first) == 20
    assert {message.get_type() for message in second} == {"HEARTBEAT"}
    said = heard(vehicle, dialect.MAVLink_command_long_message(1, 1, 176, 0, 1, 4, 0, 0, 0, 0, 0), 1)
    assert [message.get_type() for message in said] == ["COMMAND_ACK", "HEARTBEAT"]
    assert [message.get_type() for message in vehicle.waiting(0)] == ["HEARTBEAT"]


def test_a_copter_whose_autopilot_restarts_in_the_air_falls_and_starts_anew_on_the_ground(station: Station) -> None:
    station.vehicle = Vehicle(HOME, faults=Faults(reboots=(30.0,)))
    station.heartbeat()
    station.wait(4.0)
    station.fly_to(20.0)
    station.autopilot = station.vehicle.autopilot
    station.until(lambda: station.vehicle.reboots == 1, "restart")
    assert 10 < station.at.up < 20  # it has fallen for 1.2 s
    assert not station.vehicle.autopilot.armed
    station.until(lambda: station.vehicle.autopilot.flight.landed is Landed.ON_GROUND, "ground")
    assert abs(station.at.up) < 0.01
    assert station.vehicle.autopilot.mode is Mode.STABILIZE


def test_the_page_of_the_simulated_copter_tells_how_many_parameters_it_has() -> None:
    page = (Path(__file__).parents[5] / "docs/guides/simulation.md").read_text()
    assert f"- {len(COPTER)} parameters, not 1354" in page


def test_parameters_can_be_set_before_the_vehicle_is_switched_on() -> None:
    assert Vehicle(HOME, parameters=[("RTL_ALT", 3000)]).autopilot.parameters["RTL_ALT"] == 3000
    with pytest.raises(ValueError, match="has no parameter 'RTL_HEIGHT'"):
        Vehicle(HOME, parameters=[("RTL_HEIGHT", 3000)])


@pytest.mark.parametrize("command", [dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, dialect.MAV_CMD_DO_SET_RELAY])
def test_a_parameter_of_the_payload_that_is_no_number_does_not_end_the_simulation(command: int) -> None:
    station, nothing = Station(), float("nan")
    assert station.command(command, nothing, 0, 0, 0, nothing) in (ACCEPTED, DENIED, FAILED)
    assert station.command(command, 0, 0, 0, 0, nothing) == ACCEPTED
