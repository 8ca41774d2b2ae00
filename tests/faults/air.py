"""A bridge and a simulated copter in virtual time with a link that is as bad as a fault says: real bytes both ways."""

import math
import resource
from collections.abc import Callable
from pathlib import Path

from bridged.simulation.vehicle.fault_injection import Faults, LinkFaults, VehicleFaults
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.wire.term_text import write
from schemas.wire.terms import Term
from tests.bridged.sky import Message, Sky
from tests.faults.rows import Ended, Row

GOAL = (-27.603683, -48.518052, 20.0)
"""53 m from home: degrees, degrees, metres above home."""
NEAR, HOME_NEAR = 1.5, 3.0
"""Metres."""


class BadAir(Sky):
    """One vehicle, one bridge, and bad air between them."""

    def __init__(self, state: Path, *faults: str, vehicle: Vehicle | None = None) -> None:
        super().__init__(state, vehicle=vehicle)
        self.faults(*faults)
        self.station: Callable[[float], list[Message]] = lambda now: []
        """What another ground station says to the vehicle now."""

    def faults(self, *texts: str) -> None:
        """Let these faults hold from now on."""
        declared = Faults.parse(texts) if texts else Faults()
        self.air_up, self.air_down = LinkFaults(declared, "up"), LinkFaults(declared, "down")
        self.vehicle.vehicle_faults = VehicleFaults(declared)

    def step(self) -> None:
        """Let 20 ms of mission time pass for all."""
        for message in self.station(self.clock.time):
            self.downlink.extend(self.vehicle.receive(message))
        super().step()

    def perform(self, row: Row, name: str, *parameters: Term, within: float = 400.0) -> Ended:
        """Perform an action to its end, judge it by the vehicle's own state, and note it in the row."""
        began = self.clock.time
        heard = self.begin(name, *parameters)
        self.forward(lambda: heard[-1].final, f"the end of {name}", within)
        held = self.holds(name, *parameters)
        took = self.clock.time - began
        identity = heard[-1].id
        finals = tuple(one for one in self.statuses if one.id == identity and one.final)
        call = f"{name}({', '.join(map(write, parameters))})" if parameters else name
        row.ended.append(Ended(call, finals, held, took))
        return row.ended[-1]

    def fly(self, row: Row, times: int = 1) -> None:
        """The paper's mission; what fails is asked for again, so often in all, as a plan would."""
        for name, *parameters in (
            ("set_mode", "GUIDED"),
            ("arm_motors", True),
            ("takeoff", 5),
            ("goto", *GOAL),
            ("return_to_launch",),
        ):
            for _ in range(times):
                if self.perform(row, str(name), *parameters).finals[-1].state == "succeeded":
                    break

    def holds(self, name: str, *parameters: Term) -> bool:
        """Whether the vehicle's own state shows what an action wants."""
        copter = self.vehicle.autopilot
        place, home = copter.place, copter.home_on_chart
        at = copter.motion.position
        up, away = at.up - home.up, math.hypot(at.north - home.north, at.east - home.east)
        match name:
            case "set_mode":
                return copter.mode.name == parameters[0]
            case "arm_motors":
                return copter.armed == parameters[0]
            case "takeoff":
                return isinstance(parameters[0], int | float) and abs(up - parameters[0]) <= 0.5
            case "goto":
                latitude, longitude, height = (float(one) for one in parameters)  # type: ignore[arg-type]
                aside = max(abs(place.lat - latitude), abs(place.lon - longitude) * 0.886) * 111_195
                return aside <= NEAR and abs(up - height) <= NEAR
            case "return_to_launch":
                return not copter.armed and away <= HOME_NEAR
        raise AssertionError(f"no judge for {name}")


def resident() -> float:
    """MB that this process has held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
