"""A copter with PX4."""

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.copter_flight import Flight
from bridged.simulation.vehicle.motion.dynamics import Limits, Vector
from bridged.simulation.vehicle.motion.tasks import GoTo, Land, TakeOff, Task
from bridged.simulation.vehicle.px4 import parameters
from bridged.simulation.vehicle.px4.copter_tuning import DETECTED_S, copter_tuning, stream_limits
from bridged.simulation.vehicle.px4.px4 import Px4


class Px4Copter(Px4):
    """A quadrotor."""

    NAME: ClassVar = "copter"
    TYPE: ClassVar = dialect.MAV_TYPE_QUADROTOR
    ROWS: ClassVar = parameters.rows(parameters.COPTER)
    LOCOMOTION: ClassVar = Flight
    TUNING: ClassVar = staticmethod(copter_tuning)
    DETECTED_S: ClassVar = DETECTED_S
    flight: Flight

    @property
    def stream_limits(self) -> Limits:
        """Limits of the way to a place that is streamed in OFFBOARD."""
        return stream_limits(self.parameters)

    def begin_takeoff(self, up: float) -> None:
        """Take off to an altitude on the map."""
        self.flight.begin(TakeOff(up))

    def landing(self) -> Task:
        """Return what it does in AUTO.LAND."""
        return Land()

    def going(self, goal: Vector, heading: float | None = None, radius: float = math.nan) -> Task:
        """Return how it goes to a goal and stays there."""
        return GoTo(goal, heading)

    def return_height(self) -> float:
        """Return the height above home of a return from here, in metres."""
        return self.flight.tuning.return_height(self.motion.position.distance(self.home_on_chart))
