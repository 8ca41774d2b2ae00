"""A rover with PX4: it steers by its wheels, and counts as in the air while it is under way."""

from __future__ import annotations

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.rover_drive import RoverDrive, RoverTuning
from bridged.simulation.vehicle.motion.tasks import GoTo, Landed, Stop, Task
from bridged.simulation.vehicle.notifications import Result
from bridged.simulation.vehicle.parameters import Parameters
from bridged.simulation.vehicle.px4 import missions, parameters
from bridged.simulation.vehicle.px4.modes import Mode
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.texts import CRITICAL

UNDER_WAY_S = 0.5
"""Seconds from arming until a rover is taken for under way (recorded)."""
_LANDED_S = 0.07
"""Seconds from AUTO.LAND, or from home in AUTO.RTL, until it is taken for landed, at any speed (recorded)."""
_AT_HOME = 0.5
"""Metres around home at which a return ends."""
_REACHED = 1.0
"""Metres around an item of a mission at which the next one begins, at least."""


def _tuning(values: Parameters, speed: float | None) -> RoverTuning:
    return RoverTuning(
        speed=min(speed or values["RO_SPEED_LIM"], values["RO_SPEED_LIM"]),
        accel=2.0,
        brake=1.0,
        turn_rate=math.radians(90),
        radius=max(_REACHED, values["NAV_ACC_RAD"]),
        roll_out=1.0,
        delay=0.3,
        overshoot=1.25,
    )


class Px4Rover(Px4):
    """A rover."""

    NAME: ClassVar = "rover"
    TYPE: ClassVar = dialect.MAV_TYPE_GROUND_ROVER
    ROWS: ClassVar = parameters.rows(parameters.ROVER)
    LOCOMOTION: ClassVar = RoverDrive
    TUNING: ClassVar = staticmethod(_tuning)
    READY_S: ClassVar = 0.95
    takes_off: ClassVar = False
    skips_takeoff: ClassVar = True
    climbs_first: ClassVar = False
    altitude_acceptance: ClassVar = 1e6
    flight: RoverDrive
    _landed_for = 0.0

    def begin_takeoff(self, up: float) -> None:
        """Do nothing: a rover stays on the ground."""

    def holding(self) -> Task:
        """Stop here."""
        return Stop(hard=True)

    def landing(self) -> Task:
        """Stop here; then it is disarmed."""
        return Stop(hard=True)

    def going(self, goal: Vector, heading: float | None = None, radius: float = math.nan) -> Task:
        """Drive to a goal and stop there."""
        return GoTo(goal)

    def returning(self) -> Task:
        """Drive home."""
        return GoTo(self.home_on_chart)

    def _announce_return(self) -> None:
        self.send_text("RTL: land at destination")
        super()._announce_return()
        self._returning = False

    def mission_task(self, item: Item, goal: Vector) -> Task:
        """Return how an item of the mission is driven."""
        after = self.missions.item(item.seq + 1)
        passes = after is not None and after.command in missions.NAV_COMMANDS and item.params[0] <= 0
        return GoTo(goal, smooth=passes)

    def near(self, goal: Vector) -> bool:
        """Return whether it is near enough to a goal to drive on."""
        return self.motion.position.distance(goal) <= max(_REACHED, self.parameters["NAV_ACC_RAD"])

    def disarm(self, by: str, *, force: bool = False) -> Result:
        """Switch the motors off; refused while it is taken for under way, unless forced."""
        if self.armed and self.flight.landed is not Landed.ON_GROUND and not force:
            self.send_text("Disarming denied: not landed", CRITICAL)
            return Result.TEMPORARILY_REJECTED
        return super().disarm(by, force=True)

    @property
    def _lands(self) -> bool:
        """Whether it takes itself for landed: in AUTO.LAND, and at home in AUTO.RTL."""
        if self.mode is Mode.RTL:
            return self.motion.position.distance(self.home_on_chart) < _AT_HOME
        return self.mode is Mode.LAND

    def _move(self, dt: float) -> None:
        flight = self.flight
        flight.step(dt)
        if not self.armed:
            return
        self.battery.step(dt)
        if not self.flown and self.now - self.armed_at >= UNDER_WAY_S:
            self.flown = True
            self.send_text("Takeoff detected")
        if self.flown:
            self._judge_landed(dt)
        if self.mode is Mode.MISSION:
            self.navigator.follow()
        if flight.landed is Landed.ON_GROUND:
            self._idle()

    def _judge_landed(self, dt: float) -> None:
        flight = self.flight
        ground = flight.landed is Landed.ON_GROUND
        if self._lands or (ground and self.mode is Mode.RTL):
            self._landed_for += dt
            if self._landed_for < _LANDED_S:
                return
            if not ground or self.landed_at < self.armed_at:
                flight.landed = Landed.ON_GROUND
                self.touched_down()
            return
        self._landed_for = 0.0
        if not (ground and self.mode is Mode.LOITER and self.landed_at > self.armed_at):
            flight.landed = Landed.LANDING if self.mode in (Mode.RTL, Mode.LAND) else Landed.IN_AIR
