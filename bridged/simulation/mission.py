"""Missions: the list of items that AUTO mode flies, and how far it has come."""

import math
from dataclasses import dataclass

from bridged.simulation.flight import Flight
from bridged.simulation.geo import FlatMap, Place
from bridged.simulation.motion import Vector
from bridged.simulation.tasks import GoTo, Land, Return, Stage, TakeOff, Task

WAYPOINT, LOITER_TIME, RETURN_TO_LAUNCH, LAND, TAKEOFF = 16, 19, 20, 21, 22
"""Mission commands that AUTO flies (MAV_CMD)."""

NAMES = {WAYPOINT: "WP", LOITER_TIME: "LoitTime", RETURN_TO_LAUNCH: "RTL", LAND: "Land", TAKEOFF: "Takeoff"}
"""How the vehicle calls them in its texts."""

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

    def clear(self) -> None:
        """Forgets all items."""
        self.items, self.current, self.complete = [], 0, False

    def rewind(self) -> None:
        """The next AUTO begins with the first item."""
        self.current, self.complete = 0, False

    def store(self, items: list[Item]) -> None:
        """Replaces the items; `items[0]` stands for home and is not kept."""
        self.items, self.current, self.complete = items[1:], 0, False

    def item(self, seq: int) -> Item | None:
        """The item of this number, from 1."""
        return self.items[seq - 1] if 1 <= seq <= len(self.items) else None

    def next_flyable(self, after: int) -> Item | None:
        """The next item that AUTO can fly; others (cameras, jumps, ...) are passed over."""
        return next((item for item in self.items[after:] if item.command in NAMES), None)

    def start(self, item: Item, now: float) -> None:
        """This item is flown from now on."""
        self.current, self._entered_at = item.seq, now

    def done(self, item: Item, flight: Flight, now: float) -> bool:
        """Whether the item that is flown is over."""
        if item.command in (RETURN_TO_LAUNCH, LAND):
            return False  # they end with the motors
        if not flight.reached:
            self._entered_at = now
        stay = item.params[0] if item.command in (WAYPOINT, LOITER_TIME) else 0.0
        return flight.reached and now - self._entered_at >= stay


def task_of(item: Item, flight: Flight, chart: FlatMap, home: Place) -> Task:
    """What the copter does for an item."""
    here = flight.motion.position
    if item.command == TAKEOFF:
        return TakeOff(_height(item, chart, home))
    if item.command == RETURN_TO_LAUNCH:
        return Return(chart.vector(home))
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
