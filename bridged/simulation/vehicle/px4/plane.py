"""A fixed wing with PX4."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.plane_flight import PlaneFlight, PlaneMotion, PlaneTuning
from bridged.simulation.vehicle.motion.tasks import Approach, Circle, GoTo, Land, TakeOff, Task
from bridged.simulation.vehicle.notifications import MissionChanged, Result
from bridged.simulation.vehicle.parameters import Parameters
from bridged.simulation.vehicle.px4 import missions, parameters
from bridged.simulation.vehicle.px4.modes import Mode
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.texts import GLIDE_SLOPE_TOO_STEEP

_SLIP = 0.88
"""Share of the airspeed that is flown: the thrust of the recorded simulator is small."""
_AT_HOME = 1.2
"""Radii of the circle over home at which a return is over (recorded)."""
_NEAR = 35.0
"""Metres around a waypoint within which a plane turns to the next one."""
_ALTITUDE_REACHED = 3.0
_MISSION_LANDING = 1
"""RTL_TYPE"""


def _tuning(values: Parameters, speed: float | None) -> PlaneTuning:
    return PlaneTuning(
        airspeed=_SLIP * min(values["FW_AIRSPD_MAX"], max(values["FW_AIRSPD_MIN"], speed or values["FW_AIRSPD_TRIM"])),
        radius=max(20.0, values["NAV_LOITER_RAD"]),
        near=_NEAR,
        turn_rate=0.28,
        climb=2.7,
        sink=1.8,
        takeoff_climb=5.0,
        rotation=10.3,
        thrust=7.0,
        run_delay=0.5,
        takeoff_done=0.5,
        flare_height=2.0,
        flare_sink=0.4,
        roll_out=2.0,
        touchdown_to_landed=2.5,
    )


class Px4Plane(Px4):
    """A plane with a runway."""

    NAME: ClassVar = "plane"
    TYPE: ClassVar = dialect.MAV_TYPE_FIXED_WING
    ROWS: ClassVar = parameters.rows(parameters.PLANE)
    LOCOMOTION: ClassVar = PlaneFlight
    TUNING: ClassVar = staticmethod(_tuning)
    DETECTED_S: ClassVar = 0.05
    skips_takeoff: ClassVar = True
    climbs_first: ClassVar = False
    altitude_acceptance: ClassVar = 10.0
    has_airspeed: ClassVar = True
    flight: PlaneFlight
    motion: PlaneMotion
    _returned = False

    def begin_takeoff(self, up: float) -> None:
        """Roll and take off to an altitude on the map; in the air, circle and climb."""
        here = self.motion.position
        self.flight.begin(GoTo(Vector(here.north, here.east, up)) if self.flight.airborne else TakeOff(up))

    def after_takeoff(self, task: TakeOff) -> Task:
        """Circle where the takeoff has ended."""
        here = self.motion.position
        return GoTo(Vector(here.north, here.east, task.up))

    def holding(self) -> Task:
        """Circle here."""
        return GoTo(self.motion.position)

    def landing(self) -> Task:
        """Sink in a circle, wherever that is."""
        return Land()

    def going(self, goal: Vector, heading: float | None = None, radius: float = math.nan) -> Task:
        """Circle a goal; another radius is not taken (recorded)."""
        return GoTo(goal)

    @property
    def circle(self) -> Circle | None:
        """The circle that it flies."""
        task = self.flight.task
        if not isinstance(task, GoTo) or task.smooth or self.mode is Mode.OFFBOARD:
            return super().circle
        return Circle(task.goal, task.radius or self.flight.tuning.radius, self.flight.tuning.airspeed)

    def returning(self) -> Task:
        """Circle over home, high."""
        home = self.home_on_chart
        return GoTo(Vector(home.north, home.east, home.up + self.return_height()))

    def _begin_return(self) -> None:
        landing = self.missions.landing if self.missions.valid else None
        self._returned, self.lands_by_mission = False, False
        if self.parameters["RTL_TYPE"] == _MISSION_LANDING and landing is not None and self.flight.airborne:
            self.lands_by_mission = True
            home = self.home or self.chart.origin
            self.send_text("Executing Mission")
            self.send_text(f"RTL Mission land: climb to {home.alt + self.return_height():.0f} m")
            here = self.motion.position
            self.missions.current, self.missions.complete = landing, False
            self.events.append(MissionChanged())
            self.flight.begin(GoTo(Vector(here.north, here.east, self.home_on_chart.up + self.return_height())))
            return
        super()._begin_return()

    def _follow(self) -> None:
        if self.mode is not Mode.RTL:
            super()._follow()
        elif self.lands_by_mission:
            self._follow_to_landing()
        elif not self._returned and self.flight.target is not None:
            away = self.motion.position.distance(self.flight.target)
            if away <= _AT_HOME * self.flight.tuning.radius:
                self._returned = True
                self.send_text("RTL: completed, loitering")

    def _follow_to_landing(self) -> None:
        task = self.flight.task
        item = self.missions.item(self.missions.current)
        climbs = item is not None and item.command == missions.LAND_START
        if climbs and isinstance(task, GoTo):
            if abs(task.goal.up - self.motion.up.position) < 10.0:
                self.navigator.go_on()
        else:
            self.navigator.follow()

    def touched_down(self) -> None:
        """Take note of a landing."""
        if self.lands_by_mission and self.mode is Mode.RTL:
            self.navigator.landed()
        super().touched_down()

    def disarm(self, by: str, *, force: bool = False) -> Result:
        """Stop the motor; after the landing of a mission its mode is AUTO.MISSION."""
        by_mission = self.lands_by_mission and self.mode is Mode.RTL
        result = super().disarm(by, force=force)
        if by_mission and result is Result.ACCEPTED and not self.armed:
            self.mode = self.intended = Mode.MISSION
        return result

    def landing_problem(self, items: list[Item]) -> tuple[int, int] | None:
        """A landing must not be steeper than FW_LND_ANG."""
        places = [item for item in items if item.command in missions.WITH_PLACE]
        for before, item in pairwise(places):
            if item.command == missions.LAND:
                start = self.chart.at(before.x / 1e7, before.y / 1e7, 0.0)
                away = start.distance(self.chart.at(item.x / 1e7, item.y / 1e7, 0.0))
                if math.degrees(math.atan2(before.z - item.z, max(1.0, away))) > self.parameters["FW_LND_ANG"] + 0.1:
                    return GLIDE_SLOPE_TOO_STEEP
        return None

    def near(self, goal: Vector) -> bool:
        """Return whether it is near enough to a goal to fly on."""
        return self.motion.position.distance(goal) <= _NEAR

    def loiter_to_altitude_done(self, goal: Vector) -> bool:
        """Return whether it circles a goal at its altitude."""
        at = self.motion.position
        task = self.flight.task
        radius = task.radius if isinstance(task, GoTo) and task.radius else self.flight.tuning.radius
        return abs(goal.up - at.up) < _ALTITUDE_REACHED and at.distance(goal) < abs(radius) + 20.0

    def mission_task(self, item: Item, goal: Vector) -> Task:
        """Return how an item of the mission is flown."""
        if item.command == missions.LAND:
            return Approach(goal)
        if item.command == missions.LOITER_TO_ALT:
            return GoTo(goal, radius=item.params[1] or None)
        return GoTo(goal, smooth=item.command == missions.WAYPOINT)
