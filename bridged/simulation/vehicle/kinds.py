"""The vehicles that can be simulated: what moves, and the autopilot that moves it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.battery import battery_parameters as ardupilot_battery
from bridged.simulation.vehicle.ardupilot.copter import Copter
from bridged.simulation.vehicle.ardupilot.messages import ArduPilotMessages
from bridged.simulation.vehicle.ardupilot.parameters import Parameters
from bridged.simulation.vehicle.ardupilot.plane import Plane
from bridged.simulation.vehicle.ardupilot.rover import Rover
from bridged.simulation.vehicle.autopilot import CHARGE_S, Autopilot, BootKind
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.messages import MessageHandler
from bridged.simulation.vehicle.px4.battery import battery_parameters as px4_battery
from bridged.simulation.vehicle.px4.copter import Px4Copter
from bridged.simulation.vehicle.px4.fence import Fence
from bridged.simulation.vehicle.px4.messages import Px4Messages
from bridged.simulation.vehicle.px4.missions import Missions
from bridged.simulation.vehicle.px4.parameters import Parameters as Px4Parameters
from bridged.simulation.vehicle.px4.plane import Px4Plane
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.rover import Px4Rover
from bridged.simulation.vehicle.px4.state import Stored

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
    battery: Callable[[float], list[tuple[str, float]]]
    """Parameters of a battery that lasts so many minutes in the air."""

    def check(self, setting: tuple[str, float]) -> None:
        """Raises ValueError for a parameter that the autopilot does not have."""
        self.autopilot(Place(0.0, 0.0, 0.0), 0.0, "quick", 1, [setting], CHARGE_S)


def _ardupilot(made: type[ArduPilot]) -> VehicleKind:
    def make(
        place: Place, heading: float, boot: BootKind, system: int, settings: Settings, charge_time: float
    ) -> Autopilot:
        stored = Parameters(system, made.ROWS)
        for name, value in settings:
            if stored.set(name, value) is None:
                raise ValueError(f"the simulated {made.NAME} has no parameter {name!r}")
        return made.made(place, heading=heading, boot=boot, parameters=stored, charge_time=charge_time)

    return VehicleKind(made.NAME, make, ArduPilotMessages, ardupilot_battery)


def _px4(kind: str, made: type[Px4]) -> VehicleKind:
    def make(
        place: Place, heading: float, boot: BootKind, system: int, settings: Settings, charge_time: float
    ) -> Autopilot:
        parameters = Px4Parameters(system, *made.TABLES)
        unknown = parameters.set_all(settings)
        if unknown is not None:
            raise ValueError(f"the simulated {kind} has no parameter {unknown!r}")
        return made.made(place, heading, boot, Stored(parameters, Missions(), Fence(parameters)), charge_time)

    return VehicleKind(kind, make, Px4Messages, px4_battery)


COPTER = _ardupilot(Copter)
KINDS = {
    ("copter", "ardupilot"): COPTER,
    ("plane", "ardupilot"): _ardupilot(Plane),
    ("rover", "ardupilot"): _ardupilot(Rover),
    ("copter", "px4"): _px4("copter", Px4Copter),
    ("plane", "px4"): _px4("plane", Px4Plane),
    ("rover", "px4"): _px4("rover", Px4Rover),
}
"""All kinds by vehicle and autopilot."""
