"""Missions: the list of items that AUTO mode flies, and how far it has come."""

import math
from dataclasses import dataclass

from bridged.simulation.copter.dynamics import Vector
from bridged.simulation.copter.flight_control import Flight
from bridged.simulation.copter.flight_tasks import GoTo, Land, Return, Stage, Stop, TakeOff, Task
from bridged.simulation.copter.geodesy import FlatMap, Place

WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, RETURN_TO_LAUNCH, LAND, TAKEOFF = 16, 17, 19, 20, 21, 22
SPLINE, DELAY = 82, 93
CONDITION_DELAY, CONDITION_YAW, JUMP, CHANGE_SPEED, SET_HOME = 112, 115, 177, 178, 179
SET_SERVO, REPEAT_SERVO, FENCE_ENABLE, GRIPPER = 183, 184, 207, 211
"""Mission commands (MAV_CMD)."""

NAMES = {
    WAYPOINT: "WP",
    LOITER_UNLIMITED: "LoitUnlim",
    LOITER_TIME: "LoitTime",
    RETURN_TO_LAUNCH: "RTL",
    LAND: "Land",
    TAKEOFF: "Takeoff",
    SPLINE: "SplineWP",
    DELAY: "Delay",
}
"""What AUTO flies, and how the vehicle calls it in its texts."""

DEEDS = {
    CONDITION_DELAY: "CondDelay",
    CONDITION_YAW: "CondYaw",
    CHANGE_SPEED: "ChangeSpeed",
    SET_HOME: "SetHome",
    SET_SERVO: "SetServo",
    REPEAT_SERVO: "RepeatServo",
    FENCE_ENABLE: "FenceEnable",
    GRIPPER: "Gripper",
}
"""What AUTO does on the way to the next place."""

PASSED_OVER = frozenset(
    (18, 92, 94, 114, 181, 182, 188, 189, 195, 197, 201, 202, 203, 205, 206, 208, 216, 217, 218, 222, 223)
)
"""Commands that a real one would obey (cameras, relays, circles, ...): they are stored, and do nothing."""

KNOWN = frozenset((JUMP, *NAMES, *DEEDS)) | PASSED_OVER
"""A mission with other commands is refused."""

MOST_STEPS = 255
"""Items without a place that are looked at for the next one with a place; a mission of jumps alone ends."""

GLOBAL_FRAMES = (0, 5)
"""Coordinate frames whose altitude is above mean sea level."""

RELATIVE_FRAMES = (3, 6, 10, 11)
"""Coordinate frames whose altitude is above home; terrain counts as flat at home's height."""


@dataclass(frozen=True, slots=True)
class Item:
    """One mission item with the fields of MISSION_ITEM_INT."""

    seq: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int = 1


class Mission:
    """The stored items without item 0, which is home, and the progress of AUTO through them."""

    def __init__(self) -> None:
        self.items: list[Item] = []
        self.current = 0
        self.complete = False
        self._entered_at = 0.0
        self._jumped: dict[int, int] = {}

    def clear(self) -> None:
        """Forgets all items."""
        self.items = []
        self.rewind()

    def rewind(self) -> None:
        """The next AUTO begins with the first item."""
        self.current, self.complete = 0, False
        self._jumped.clear()

    def store(self, items: list[Item]) -> None:
        """Replaces the items; `items[0]` stands for home and is not kept."""
        self.items = items[1:]
        self.rewind()

    def item(self, seq: int) -> Item | None:
        """The item of this number, from 1."""
        return self.items[seq - 1] if 1 <= seq <= len(self.items) else None

    @property
    def flyable(self) -> bool:
        """Whether there is anything that AUTO can fly."""
        return any(item.command in NAMES for item in self.items)

    def next_place(self, seq: int) -> tuple[list[Item], Item | None]:
        """What is to be done from item `seq` on, and then the next item to fly; None at the end of the mission."""
        deeds: list[Item] = []
        for _ in range(MOST_STEPS):
            item = self.item(seq)
            if item is None or item.command in NAMES:
                return deeds, item
            if item.command == JUMP:
                seq = self._jump(item)
                continue
            if item.command in DEEDS:
                deeds.append(item)
            seq += 1
        return deeds, None

    def _jump(self, item: Item) -> int:
        """Where a DO_JUMP leads: to its item so many times (for ever if negative), then past it."""
        times = self._jumped.get(item.seq, 0)
        if 0 <= item.params[1] <= times or self.item(int(item.params[0])) is None:
            return item.seq + 1
        self._jumped[item.seq] = times + 1
        return int(item.params[0])

    def start(self, item: Item, now: float) -> None:
        """This item is flown from now on."""
        self.current, self._entered_at = item.seq, now

    def done(self, item: Item, flight: Flight, now: float) -> bool:
        """Whether the item that is flown is over."""
        if item.command in (RETURN_TO_LAUNCH, LAND, LOITER_UNLIMITED):
            return False  # the first two end with the motors, the last one never
        if item.command == DELAY:
            return now - self._entered_at >= item.params[0]
        if not flight.reached:
            self._entered_at = now
        stay = item.params[0] if item.command in (WAYPOINT, LOITER_TIME, SPLINE) else 0.0
        return flight.reached and now - self._entered_at >= stay


def task_of(item: Item, flight: Flight, chart: FlatMap, home: Place) -> Task:
    """What the copter does for an item."""
    here = flight.motion.position
    if item.command == TAKEOFF:
        return TakeOff(_height(item, chart, home))
    if item.command == RETURN_TO_LAUNCH:
        return Return(chart.vector(home))
    if item.command == DELAY:
        return Stop()
    goal = goal_of(item, chart, home)
    if item.command == LAND:
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
