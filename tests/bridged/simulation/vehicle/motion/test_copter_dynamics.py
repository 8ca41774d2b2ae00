"""The simulated copter needs the time that the recorded one needed, within 10 %. Virtual time, no clock.

`pytest tests/bridged/simulation/vehicle/motion/test_copter_dynamics.py -s` prints recorded and simulated figures side
by side.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Landed
from tests.bridged.virtual_copter import Station

RECORDED: dict[str, Any] = json.loads((Path(__file__).parents[4] / "data" / "dynamics.json").read_text())
TOLERANCE = 0.10
SAMPLING_S = 0.1
"""Recorded and simulated positions are looked at every 0.1 s."""


def recorded(table: str, file: str, entry: str) -> dict[str, Any]:
    found: dict[str, Any] = next(row for row in RECORDED[table] if row["file"] == file and row["entry"] == entry)
    return found


def agree(what: str, simulated: float, real: float, spare: float = 0.0) -> None:
    """Within 10 %, and `spare` for what is too small for per cent."""
    print(f"{what}: recorded {real:.2f}, simulated {simulated:.2f} ({100 * (simulated - real) / real:+.1f} %)")
    assert abs(simulated - real) <= TOLERANCE * real + spare, what


@pytest.mark.parametrize(
    ("file", "entry", "pause"),
    [
        ("single_uav", "takeoff_5", 1.703),
        ("refusals", "takeoff_10", 2.118),
        ("failsafe", "takeoff_10", 1.531),
        ("dynamics", "f1_takeoff", 2.782),
        ("dynamics", "f2_takeoff", 2.752),
        ("dynamics", "f3_takeoff", 2.769),
    ],
)
def test_a_takeoff_takes_as_long_as_the_recorded_one(file: str, entry: str, pause: float) -> None:
    row = recorded("takeoff", file, entry)
    station = Station()
    took = station.fly_to(row["target_m"], pause=pause)
    agree(f"takeoff to {row['target_m']} m, s", took, row["within_10cm_after_s"])


LEGS = [
    ("single_uav", "setpoint_goal", 5.0, Vector(38.95, 30.69, 40.0)),
    ("failsafe", "setpoint_60m_north", 10.0, Vector(59.99, 0.0, 10.0)),
    ("dynamics", "f1_leg200_setpoint", 30.0, Vector(199.98, 0.0, 30.0)),
    ("dynamics", "f1_leg30_setpoint", 30.0, Vector(-30.04, 0.0, 30.0)),
    ("dynamics", "f1_leg5_setpoint", 30.0, Vector(0.0, 4.96, 30.0)),
    ("dynamics", "f1_climb30_setpoint", 30.0, Vector(0.0, 0.0, 60.0)),
    ("dynamics", "f1_descend40_setpoint", 60.0, Vector(0.0, 0.0, 20.0)),
    ("dynamics", "f1_diag100_up20_setpoint", 20.0, Vector(-100.02, 0.0, 40.0)),
]


@pytest.mark.parametrize(("file", "entry", "height", "goal"), LEGS, ids=[leg[1] for leg in LEGS])
def test_a_leg_takes_as_long_as_the_recorded_one(file: str, entry: str, height: float, goal: Vector) -> None:
    row = recorded("guided_legs", file, entry)
    station = Station()
    station.fly_to(height)
    station.setpoint(goal)
    begin, fastest = station.now, 0.0

    def near(flat: float, up: float) -> bool:
        nonlocal fastest
        velocity = station.autopilot.motion.velocity
        fastest = max(fastest, velocity.flat())
        return station.distance(goal) < flat and abs(station.at.up - goal.up) < up

    station.until(lambda: near(1.0, 1.0), "arrival within 1 m")
    agree("within 1 m after, s", station.now - begin, row["time_to_within_1m_s"])
    station.until(lambda: near(0.5, 0.4) and station.speed < 0.3, "rest at the goal")
    rest = station.now - begin
    agree("at rest at the goal after, s", rest, row["time_to_0.5m_and_0.3m_s_s"], spare=SAMPLING_S)
    if "max_horizontal_speed_m_s" in row:
        agree("fastest, m/s", fastest, row["max_horizontal_speed_m_s"], spare=0.45)


RETURNS = [
    ("single_uav", "set_mode_rtl", Vector(38.95, 30.69, 40.0)),
    ("dynamics", "f2_rtl_low_mode", Vector(-40.02, 0.0, 5.0)),
    ("dynamics", "f3_rtl_over_home_mode", Vector(0.0, 0.0, 5.0)),
]


@pytest.mark.parametrize(("file", "entry", "start"), RETURNS, ids=[item[1] for item in RETURNS])
def test_a_return_to_launch_takes_as_long_as_the_recorded_one(file: str, entry: str, start: Vector) -> None:
    row = recorded("rtl", file, entry)
    station = Station()
    station.fly_to(5.0)
    station.setpoint(start)
    station.until(lambda: station.distance(start) < 0.1 and abs(station.at.up - start.up) < 0.05, "start")
    station.wait(8.0)
    assert station.command(176, 1, Mode.RTL) == 0
    begin, copter, highest = station.now, station.autopilot, 0.0

    def away() -> float:
        nonlocal highest
        highest = max(highest, station.at.up)
        return station.distance(Vector())

    if "within_1m_of_home_after_s" in row:
        station.until(lambda: away() < 1.0, "home below")
        agree("within 1 m of home after, s", station.now - begin, row["within_1m_of_home_after_s"])
    station.until(lambda: copter.flight.landed is Landed.LANDING, "descent")
    agree("descent after, s", station.now - begin, row["landed_state_changes_s_state"][1][0])
    station.until(lambda: not copter.flight.airborne, "touchdown")
    agree("touchdown after, s", station.now - begin, row["touchdown_after_s"])
    station.until(lambda: copter.flight.landed is Landed.ON_GROUND, "landed")
    station.until(lambda: not copter.armed, "disarming")
    agree("disarmed after, s", station.now - begin, row["total_to_disarmed_heartbeat_s"])
    assert abs(max(highest, start.up) - row["max_alt_m"]) < 0.2
    assert station.distance(Vector()) < 0.1


@pytest.mark.parametrize(("file", "entry"), [("dynamics", "f1_land_mode"), ("refusals", "set_mode_land")])
def test_a_landing_takes_as_long_as_the_recorded_one(file: str, entry: str) -> None:
    row = recorded("land", file, entry)
    station = Station()
    station.fly_to(row["start_alt_m"])
    assert station.command(176, 1, Mode.LAND) == 0
    touched = station.until(lambda: not station.autopilot.flight.airborne, "touchdown")
    agree("touchdown after, s", touched, row["touchdown_after_s"])
    station.until(lambda: not station.autopilot.armed, "disarming")
    (hit,) = [text for text in station.texts() if text.startswith("SIM Hit ground")]
    assert abs(float(hit.split()[-2]) - row["touchdown_speed_m_s"]) < 0.05


def test_braking_at_cruise_speed_takes_the_recorded_time_and_distance() -> None:
    row = RECORDED["brake_mode_from_cruise"]
    station = Station()
    station.fly_to(40.0)
    station.setpoint(Vector(0.0, 300.0, 40.0))
    station.until(lambda: station.speed > row["speed_at_start_m_s"], "cruise speed")
    assert station.command(176, 1, Mode.BRAKE) == 0
    where = station.at.east
    took = station.until(lambda: station.speed < 0.3, "standstill", step=0.02)
    agree("standstill after, s", took, row["time_to_below_0.3_m_s_s"])
    station.wait(10.0)
    agree("stopping distance, m", station.at.east - where, row["stop_distance_m"])


def test_a_goal_behind_turns_the_copter_round_as_recorded() -> None:
    row = recorded("guided_legs", "dynamics", "f1_retarget_back_setpoint")
    station = Station()
    station.fly_to(40.0)
    station.setpoint(Vector(0.0, 150.0, 40.0))
    station.until(lambda: station.speed > row["speed_at_reversal_m_s"], "cruise speed", step=0.02)
    where = station.at.east
    station.setpoint(Vector(0.0, where - row["horizontal_m"], 40.0))
    took = station.until(lambda: station.autopilot.motion.velocity.east < 0, "turning round", step=0.02)
    agree("turned round after, s", took, row["time_to_turn_round_s"])
    agree("went on, m", station.at.east - where, row["went_on_further_m"])
    goal = Vector(0.0, where - row["horizontal_m"], 40.0)
    back = took + station.until(lambda: station.distance(goal) < 1.0, "arrival")
    agree("within 1 m after, s", back, row["time_to_within_1m_s"])


def test_armed_motors_without_a_takeoff_stop_after_the_recorded_time(station: Station) -> None:
    station.guided()
    assert station.command(400, 1) == 0
    took = station.until(lambda: not station.autopilot.armed, "auto-disarm")
    agree("auto-disarm after, s", took, RECORDED["failsafe"]["auto_disarm_text_after_arm_ack_s"])
    assert station.texts()[-1] == "Disarming motors"
