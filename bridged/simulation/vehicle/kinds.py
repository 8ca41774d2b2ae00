"""The vehicles that can be simulated: what moves, and the autopilot that moves it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bridged.simulation.vehicle.ardupilot.copter import Copter
from bridged.simulation.vehicle.ardupilot.messages import ArduPilotMessages
from bridged.simulation.vehicle.ardupilot.parameters import Parameters
from bridged.simulation.vehicle.autopilot import Autopilot, BootKind
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.messages import MessageHandler

AutopilotName = Literal["ardupilot", "px4"]

Settings = Sequence[tuple[str, float]]
"""Parameters by name."""


@dataclass(frozen=True, slots=True)
class VehicleKind:
    """One kind of vehicle with one autopilot."""

    name: str
    """`copter`, `plane` or `rover`."""
    autopilot: Callable[[Place, float, BootKind, int, Settings, float], Autopilot]
    """Makes the autopilot of a vehicle: place and heading (radians) of power on, boot sequence, system id, parameters
    that were set before, seconds to charge the battery. Raises ValueError for a parameter that it does not have."""
    messages: Callable[[Any], MessageHandler[Any]]
    """Makes the MAVLink side of that autopilot."""


def _copter(
    place: Place, heading: float, boot: BootKind, system: int, settings: Settings, charge_time: float
) -> Autopilot:
    stored = Parameters(system)
    for name, value in settings:
        if stored.set(name, value) is None:
            raise ValueError(f"the simulated copter has no parameter {name!r}")
    return Copter(place, heading=heading, boot=boot, parameters=stored, charge_time=charge_time)


COPTER = VehicleKind("copter", _copter, ArduPilotMessages)
