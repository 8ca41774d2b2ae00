"""The vehicles that can be simulated: what moves, and the autopilot that moves it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

from bridged.simulation.vehicle.ardupilot.battery import battery_parameters as ardupilot_battery
from bridged.simulation.vehicle.ardupilot.copter import Copter
from bridged.simulation.vehicle.ardupilot.messages import ArduPilotMessages
from bridged.simulation.vehicle.ardupilot.plane import Plane
from bridged.simulation.vehicle.ardupilot.rover import Rover
from bridged.simulation.vehicle.autopilot import CHARGE_S, Autopilot, BootKind
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.messages import MessageHandler
from bridged.simulation.vehicle.parameters import Parameters
from bridged.simulation.vehicle.px4.battery import battery_parameters as px4_battery
from bridged.simulation.vehicle.px4.copter import Px4Copter
from bridged.simulation.vehicle.px4.messages import Px4Messages
from bridged.simulation.vehicle.px4.plane import Px4Plane
from bridged.simulation.vehicle.px4.rover import Px4Rover
from schemas.files.findings import near_miss

AutopilotName = Literal["ardupilot", "px4"]


@dataclass(frozen=True, slots=True)
class VehicleKind:
    """One kind of vehicle with one autopilot."""

    autopilot: type[Autopilot]
    messages: Callable[[Any], MessageHandler[Any]]
    """Makes the MAVLink side of that autopilot."""
    battery: Callable[[float], list[tuple[str, float]]]
    """Returns the parameters of a battery that lasts a number of minutes in the air."""

    @property
    def name(self) -> str:
        """`copter`, `plane` or `rover`."""
        return self.autopilot.NAME

    def make(
        self,
        place: Place,
        heading: float = 0.0,
        boot: BootKind = "quick",
        system: int = 1,
        settings: Iterable[tuple[str, float]] = (),
        charge_time: float = CHARGE_S,
    ) -> Autopilot:
        """Make the autopilot of a vehicle: place and heading (radians) of power on, boot sequence, system id,
        parameters that were set before, seconds to charge the battery. Raises ValueError for an unknown parameter."""
        parameters = Parameters(self.autopilot.ROWS)
        for name, value in ((self.autopilot.SYSTEM_ID, system), *settings):
            if name not in parameters:
                hint = near_miss(name, [row[0] for row in self.autopilot.ROWS])
                raise ValueError(f"the simulated {self.name} has no parameter {name!r}{hint}")
            parameters.set(name, value)
        return self.autopilot(place, parameters, heading, boot, charge_time)

    def check(self, setting: tuple[str, float]) -> None:
        """Raises ValueError for a parameter that the autopilot does not have."""
        self.make(Place(0.0, 0.0, 0.0), settings=[setting])


COPTER = VehicleKind(Copter, ArduPilotMessages, ardupilot_battery)
KINDS = {
    ("copter", "ardupilot"): COPTER,
    ("plane", "ardupilot"): VehicleKind(Plane, ArduPilotMessages, ardupilot_battery),
    ("rover", "ardupilot"): VehicleKind(Rover, ArduPilotMessages, ardupilot_battery),
    ("copter", "px4"): VehicleKind(Px4Copter, Px4Messages, px4_battery),
    ("plane", "px4"): VehicleKind(Px4Plane, Px4Messages, px4_battery),
    ("rover", "px4"): VehicleKind(Px4Rover, Px4Messages, px4_battery),
}
"""All kinds by vehicle and autopilot."""
