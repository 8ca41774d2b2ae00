"""Missions: the items that AUTO mode flies, its progress, and DO commands."""

import math
from typing import TYPE_CHECKING, ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot.servo_outputs import Grip
from bridged.simulation.vehicle.geodesy import FlatMap, Place
from bridged.simulation.vehicle.mission_items import GLOBAL_FRAMES, Item, StoredMission, whole
from bridged.simulation.vehicle.motion.copter_flight import Flight
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import GoTo, Land, Return, Stage, Stop, TakeOff, Task
from bridged.simulation.vehicle.notifications import Result

if TYPE_CHECKING:
    from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot


NAV_COMMANDS = {
    dialect.MAV_CMD_NAV_WAYPOINT: "WP",
    dialect.MAV_CMD_NAV_LOITER_UNLIM: "LoitUnlim",
    dialect.MAV_CMD_NAV_LOITER_TIME: "LoitTime",
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: "RTL",
    dialect.MAV_CMD_NAV_LAND: "Land",
    dialect.MAV_CMD_NAV_TAKEOFF: "Takeoff",
    dialect.MAV_CMD_NAV_SPLINE_WAYPOINT: "SplineWP",
    dialect.MAV_CMD_NAV_DELAY: "Delay",
}
"""Navigation commands of AUTO, with their names in status texts."""

DO_COMMANDS = {
    dialect.MAV_CMD_CONDITION_DELAY: "CondDelay",
    dialect.MAV_CMD_CONDITION_YAW: "CondYaw",
    dialect.MAV_CMD_DO_CHANGE_SPEED: "ChangeSpeed",
    dialect.MAV_CMD_DO_SET_HOME: "SetHome",
    dialect.MAV_CMD_DO_SET_SERVO: "SetServo",
    dialect.MAV_CMD_DO_REPEAT_SERVO: "RepeatServo",
    dialect.MAV_CMD_DO_FENCE_ENABLE: "FenceEnable",
    dialect.MAV_CMD_DO_GRIPPER: "Gripper",
}
"""Commands that AUTO runs on the way to the next place, with their names in status texts."""

PASSED_OVER = frozenset(
    (18, 92, 94, 114, 181, 182, 188, 189, 195, 197, 201, 202, 203, 205, 206, 208, 216, 217, 218, 222, 223)
)
"""Commands that a real autopilot obeys (cameras, relays, circles, ...): stored, without effect."""

KNOWN = frozenset((dialect.MAV_CMD_DO_JUMP, *NAV_COMMANDS, *DO_COMMANDS)) | PASSED_OVER
"""A mission with other commands is refused."""

_ENDLESS = frozenset((dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH, dialect.MAV_CMD_NAV_LAND, dialect.MAV_CMD_NAV_LOITER_UNLIM))
"""The first two end with the motors, the last one never."""

_STAYING = frozenset(
    (dialect.MAV_CMD_NAV_WAYPOINT, dialect.MAV_CMD_NAV_LOITER_TIME, dialect.MAV_CMD_NAV_SPLINE_WAYPOINT)
)
"""Parameter 1 of these is the time in seconds to stay at the place."""


class Mission(StoredMission):
    """The stored items without item 0, which is home, and the progress of AUTO through them."""

    FIRST: ClassVar = 1
    FLOWN: ClassVar = NAV_COMMANDS

    def store(self, items: list[Item]) -> None:
        """Replace the items; `items[0]` is home and is not kept."""
        self.items = items[1:]
        self.rewind()

    @property
    def flyable(self) -> bool:
        """Whether there is anything that AUTO can fly."""
        return any(item.command in NAV_COMMANDS for item in self.items)

    @property
    def landing_start(self) -> int | None:
        """Number of the item DO_LAND_START; None without one."""
        return next((item.seq for item in self.items if item.command == dialect.MAV_CMD_DO_LAND_START), None)

    def start(self, item: Item, now: float) -> None:
        """Fly this item from `now` (vehicle seconds) on."""
        self.current, self.entered_at = item.seq, now

    def done(self, item: Item, flight: Flight, now: float) -> bool:
        """Return whether the item that is flown is over at `now` vehicle seconds."""
        if item.command in _ENDLESS:
            return False
        if item.command == dialect.MAV_CMD_NAV_DELAY:
            return now - self.entered_at >= item.params[0]
        if not flight.reached:
            self.entered_at = now
        stay = item.params[0] if item.command in _STAYING else 0.0
        return flight.reached and now - self.entered_at >= stay


def task_of(item: Item, flight: Flight, chart: FlatMap, home: Place) -> Task:
    """Effect of an item on the vehicle."""
    here = flight.motion.position
    if item.command == dialect.MAV_CMD_NAV_TAKEOFF:
        return TakeOff(_height(item, chart, home))
    if item.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
        return Return(chart.vector(home))
    if item.command == dialect.MAV_CMD_NAV_DELAY:
        return Stop()
    goal = goal_of(item, chart, home)
    if item.command == dialect.MAV_CMD_NAV_LAND:
        if goal is None:
            return Land()
        away = math.hypot(goal.north - here.north, goal.east - here.east)
        return Return(goal, Stage.CRUISE, Vector(goal.north, goal.east, max(here.up, 2.0)), length=away)
    return GoTo(goal or here, smooth=True)


def goal_of(item: Item, chart: FlatMap, home: Place) -> Vector | None:
    """The place of an item on the map; 0/0 means here, None a place that is not on the earth."""
    try:
        place = Place(item.x / 1e7, item.y / 1e7, home.alt)
    except ValueError:
        return None
    if not item.x and not item.y:
        return None
    goal = chart.vector(place)
    goal.up = _height(item, chart, home)
    return goal


def _height(item: Item, chart: FlatMap, home: Place) -> float:
    if not math.isfinite(item.z):
        return chart.vector(home).up
    above_sea = item.z if item.frame in GLOBAL_FRAMES else home.alt + item.z
    return above_sea - chart.origin.alt


def do(ardupilot: "ArduPilot", command: int, params: tuple[float, float, float, float]) -> Result:
    """Carry out one command (MAV_CMD) of `DO_COMMANDS`; its parameters are in the units of that command."""
    first, second, third, fourth = params
    match command:
        case dialect.MAV_CMD_DO_CHANGE_SPEED:
            return _change_speed(ardupilot, first, second)
        case dialect.MAV_CMD_CONDITION_YAW:
            return _turn(ardupilot, first, third, relative=fourth == 1.0)
        case dialect.MAV_CMD_DO_SET_HOME:
            ardupilot.set_home(ardupilot.place)
        case dialect.MAV_CMD_DO_FENCE_ENABLE:
            if first not in (0.0, 1.0):
                return Result.FAILED
            ardupilot.parameters.set("FENCE_ENABLE", first)
        case dialect.MAV_CMD_DO_SET_SERVO:
            return _unless(ardupilot, ardupilot.outputs.set(whole(first), whole(second)))
        case dialect.MAV_CMD_DO_REPEAT_SERVO:
            problem = ardupilot.outputs.repeat(whole(first), whole(second), whole(third), fourth, ardupilot.now)
            return _unless(ardupilot, problem)
        case dialect.MAV_CMD_DO_GRIPPER:
            return _grip(ardupilot, second)
    return Result.ACCEPTED


def _change_speed(ardupilot: "ArduPilot", kind: float, speed: float) -> Result:
    """m/s over the ground, until another mode."""
    if kind not in (0.0, 1.0) or not 0.2 <= speed <= 50:
        return Result.FAILED
    ardupilot.flight.cruise_speed = speed
    return Result.ACCEPTED


def _turn(ardupilot: "ArduPilot", angle: float, direction: float, *, relative: bool) -> Result:
    """Degrees from north, or from where the nose points."""
    if ardupilot.mode not in (ardupilot.MODES.GUIDED, ardupilot.MODES.AUTO) or not 0 <= angle <= 360:
        return Result.FAILED
    heading = math.radians(angle)
    if relative:
        heading = ardupilot.motion.heading + (heading if direction >= 0 else -heading)
    ardupilot.flight.heading_wish = heading % (2 * math.pi)
    return Result.ACCEPTED


def _grip(ardupilot: "ArduPilot", action: float) -> Result:
    if ardupilot.parameters["GRIP_ENABLE"] < 1:
        return Result.FAILED
    if action not in (0.0, 1.0):
        return Result.DENIED
    ardupilot.send_text(ardupilot.outputs.grip(Grip(int(action)), ardupilot.now))
    return Result.ACCEPTED


def _unless(ardupilot: "ArduPilot", problem: str | None) -> Result:
    if problem is None:
        return Result.ACCEPTED
    ardupilot.send_text(problem)
    return Result.FAILED
