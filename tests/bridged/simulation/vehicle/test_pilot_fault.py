"""A pilot who takes a simulated copter over, and gives it back or lands it."""

from __future__ import annotations

import pytest

from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.fault_injection import Faults, VehicleFaults


def switched(fault: str, *times: float, airborne: bool = True) -> list[Mode]:
    """Return the mode at each time of a vehicle that begins in GUIDED."""
    vehicle_faults, mode, found = VehicleFaults(Faults.parse([fault])), Mode.GUIDED, []
    for now in times:
        mode = Mode(vehicle_faults.switched_mode(now, mode, airborne=airborne) or mode)
        found.append(mode)
    return found


def test_a_pilot_has_a_vehicle_and_gives_it_back_in_its_mode() -> None:
    assert switched("pilot=5+10", 4, 5, 14, 15, 20) == [Mode.GUIDED, Mode.LOITER, Mode.LOITER, Mode.GUIDED, Mode.GUIDED]


def test_a_pilot_may_land_it() -> None:
    assert switched("pilot=5+10:lands", 6, 16) == [Mode.LOITER, Mode.LAND]


def test_a_pilot_leaves_a_vehicle_on_the_ground() -> None:
    assert switched("pilot=5+10", 6, airborne=False) == [Mode.GUIDED]


def test_a_vehicle_that_a_failsafe_puts_down_was_not_landed_by_the_pilot_who_had_it() -> None:
    for flies_to_the_end in (True, False):
        vehicle_faults = VehicleFaults(Faults.parse(["pilot=5+10:lands"]))
        vehicle_faults.switched_mode(6, Mode.GUIDED, airborne=True)
        vehicle_faults.switched_mode(16, Mode.LAND, airborne=flies_to_the_end)
        vehicle_faults.switched_mode(26, Mode.LAND, airborne=False)
        assert vehicle_faults.switch is None
        assert vehicle_faults.landed is flies_to_the_end


@pytest.mark.parametrize("fault", ["pilot=5", "pilot=5+x", "pilot=5+3:crashes"])
def test_a_pilot_fault_that_is_none_is_refused(fault: str) -> None:
    with pytest.raises(ValueError, match="expected pilot="):
        Faults.parse([fault])
