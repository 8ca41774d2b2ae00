"""Wind, and a GPS that is lost or wrong: what the simulated copter does, and what its autopilot says of it."""

import math
import statistics
from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import telemetry
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.autopilot import FOUND_S, NOTICED_S, STEP_S, TIMEOUT_S
from bridged.simulation.vehicle.fault_injection import Faults, WindFault
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import GoTo
from bridged.simulation.vehicle.vehicle import Vehicle, Wind

HOME = Place(-27.604033, -48.518363, 21.0)
UP = 10.0
GPS_BIT = 1 << 5
HORIZONTAL = dialect.EKF_POS_HORIZ_ABS


class Flight:
    """A copter with faults that hovers `UP` metres high in GUIDED, and what it has said since."""

    def __init__(self, *faults: str) -> None:
        self.vehicle = Vehicle(HOME, faults=Faults.parse(faults))
        self.autopilot = self.vehicle.autopilot
        self.texts: list[str] = []
        self.vehicle.channels[0].heard = True
        self.after(4)
        self.autopilot.set_mode(Mode.GUIDED)
        self.autopilot.arm()
        self.autopilot.take_off(UP)
        self.after(16)
        assert self.autopilot.motion.up.position == pytest.approx(UP, abs=0.3)

    def after(self, seconds: float, look: Callable[[], None] = lambda: None) -> None:
        for _ in range(round(seconds / STEP_S)):
            for message in self.vehicle.advance(STEP_S):
                if message.get_type() == "STATUSTEXT":
                    self.texts.append(message.text.decode() if isinstance(message.text, bytes) else message.text)
            look()

    def until(self, age: float) -> None:
        self.after(age - self.vehicle.age)

    def leg(self, north: float) -> float:
        """Return the seconds of a leg to a place north of home."""
        began = self.vehicle.age
        self.autopilot.guide(GoTo(Vector(north, 0.0, UP)))
        while not self.autopilot.flight.reached:
            self.after(STEP_S)
        return self.vehicle.age - began

    def off(self) -> float:
        """Return how far it is from home in truth, in metres."""
        return math.hypot(self.autopilot.truth.north, self.autopilot.truth.east)


@pytest.fixture(scope="module")
def still() -> Flight:
    return Flight()


def test_a_hovering_copter_drifts_with_gusts_and_holds_its_place_against_the_mean_wind() -> None:
    flight, away = Flight("wind=10:270:3"), []
    flight.after(60, lambda: away.append(flight.autopilot.truth.east))
    assert 0.1 < statistics.pstdev(away) < 3
    assert abs(statistics.fmean(away)) < 1


def test_a_leg_against_a_strong_wind_takes_longer_and_one_with_it_does_not(still: Flight) -> None:
    windy = Flight("wind=18:0")
    assert windy.leg(150) > 1.2 * still.leg(150)
    assert windy.leg(0) < 1.1 * still.leg(0)


def test_wind_drains_the_battery(still: Flight) -> None:
    windy = Flight("wind=15:90")
    assert windy.autopilot.battery.current > 1.05 * still.autopilot.battery.current


def test_gusts_have_the_strength_that_was_asked_for_and_are_the_same_for_a_seed() -> None:
    wind, again, other = (Wind(WindFault(5, 0, 2), seed) for seed in (1, 1, 2))
    speeds = [wind.step(STEP_S).north for _ in range(50_000)]
    assert statistics.fmean(speeds) == pytest.approx(-5, abs=0.5)
    assert statistics.pstdev(speeds) == pytest.approx(2, rel=0.15)
    assert [again.step(STEP_S).north for _ in range(50_000)] == speeds
    assert other.step(STEP_S).north != speeds[0]


def test_a_copter_without_gps_lands_where_the_wind_carries_it() -> None:
    flight = Flight("wind=5:180", "gps-loss=30+200")
    flight.until(30 + TIMEOUT_S - 1)
    raw = telemetry.gps_raw_int(flight.autopilot)
    assert (raw.fix_type, raw.satellites_visible) == (1, 0)
    assert not telemetry.sys_status(flight.autopilot).onboard_control_sensors_health & GPS_BIT
    assert telemetry.ekf_status_report(flight.autopilot).flags & HORIZONTAL
    assert flight.autopilot.mode is Mode.GUIDED
    flight.until(30 + TIMEOUT_S + NOTICED_S + 1)
    assert not telemetry.ekf_status_report(flight.autopilot).flags & HORIZONTAL
    assert telemetry.BUILDERS[32](flight.autopilot) is None
    assert flight.autopilot.mode is Mode.LAND
    assert flight.texts[-2:] == ["EKF variance: over thresholds", "EKF Failsafe: changed to LAND Mode"]
    flight.after(40)
    assert not flight.autopilot.armed
    assert flight.autopilot.truth.north > 20
    flight.autopilot.set_mode(Mode.GUIDED)
    assert {"Need Position Estimate", "GPS 1: Bad fix"} <= set(flight.autopilot.arming_problems())


def test_a_gps_that_comes_back_in_time_is_used_on() -> None:
    flight = Flight(f"gps-loss=30+{TIMEOUT_S - 1}")
    flight.until(60)
    assert flight.autopilot.mode is Mode.GUIDED
    assert flight.autopilot.has_position


def test_a_position_is_found_again_where_the_copter_is_in_truth() -> None:
    flight = Flight("wind=5:180", "gps-loss=30+12")
    flight.until(42 + FOUND_S - 1)
    assert not flight.autopilot.has_position
    flight.until(42 + FOUND_S + 1)
    assert flight.autopilot.has_position
    assert flight.autopilot.motion.position == flight.autopilot.truth
    assert flight.autopilot.truth.north > 10
    assert "EKF Failsafe Cleared" in flight.texts


def test_a_jump_of_the_gps_is_rejected_while_it_is_short() -> None:
    flight = Flight("gps-jump=30+5:40")
    flight.until(33)
    raw, position = telemetry.gps_raw_int(flight.autopilot), telemetry.BUILDERS[33](flight.autopilot)
    assert math.hypot(raw.lat - position.lat, raw.lon - position.lon) > 1000
    assert telemetry.ekf_status_report(flight.autopilot).flags & dialect.EKF_GPS_GLITCHING
    flight.until(40)
    assert [text for text in flight.texts if "litch" in text] == ["GPS Glitch or Compass error", "Glitch cleared"]
    assert flight.off() < 1


def test_a_jump_of_the_gps_that_lasts_is_believed_and_flown_by() -> None:
    flight = Flight("gps-jump=30+60:40")
    flight.autopilot.guide(GoTo(Vector(0.0, 0.0, UP)))
    flight.until(70)
    assert flight.autopilot.motion.position.flat() < 1
    assert flight.off() == pytest.approx(40, abs=1)


def test_a_small_error_of_the_gps_is_flown_by_immediately() -> None:
    flight = Flight("gps-jump=30+60:3")
    flight.autopilot.guide(GoTo(Vector(0.0, 0.0, UP)))
    flight.until(50)
    assert flight.off() == pytest.approx(3, abs=0.5)
    assert not [text for text in flight.texts if "litch" in text]


@pytest.mark.parametrize(
    "fault", ["wind=5", "wind=5:0:1:2", "wind=50:0", "gps-loss=5", "gps-jump=5+3", "gps-jump=5+3:x"]
)
def test_a_fault_of_wind_or_gps_that_is_none_is_refused(fault: str) -> None:
    with pytest.raises(ValueError, match=f"expected {fault.partition('=')[0]}="):
        Faults.parse([fault])
