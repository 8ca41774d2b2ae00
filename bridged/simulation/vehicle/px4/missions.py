"""The stored mission of the simulated PX4: its items from 0, whether it can be flown, and its progress."""

import math
from enum import IntEnum
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.mission_items import Item, StoredMission

WAYPOINT, LOITER_UNLIM, LOITER_TIME, RTL, LAND, TAKEOFF, LOITER_TO_ALT, DELAY = 16, 17, 19, 20, 21, 22, 31, 93
NAV_COMMANDS = frozenset((WAYPOINT, LOITER_UNLIM, LOITER_TIME, RTL, LAND, TAKEOFF, LOITER_TO_ALT, DELAY))
"""Navigation commands that are flown."""
WITH_PLACE = frozenset((WAYPOINT, LOITER_UNLIM, LOITER_TIME, LAND, TAKEOFF, LOITER_TO_ALT))
LAND_START = dialect.MAV_CMD_DO_LAND_START
KNOWN = NAV_COMMANDS | frozenset((
    84, 85, 112, 114, 115, 177, 178, 179, 183, 187, LAND_START, 195, 196, 197, 200, 201, 203, 204, 205, 206, 211, 214,
    530, 531, 532, 1000, 2000, 2001, 2500, 2501, 3000,
))  # fmt: skip
"""A mission with other commands is refused."""

REPEATS = 10
"""Times that MISSION_ITEM_REACHED is sent again, each second (recorded)."""


class State(IntEnum):
    """mission_state of MISSION_CURRENT (MISSION_STATE)."""

    NONE = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


class Missions(StoredMission):
    """Items of the mission, and where it is."""

    FIRST: ClassVar = 0
    FLOWN: ClassVar = NAV_COMMANDS

    def __init__(self) -> None:
        super().__init__()
        self.problem: tuple[int, int] | str | None = None
        """Why it cannot be flown: an EVENT without a text, or a text; None: it can, if there is one."""
        self.reached: int | None = None
        """The item that was reached last, reported again ..."""
        self.repeats = 0
        """... so many times more ..."""
        self.next_repeat = math.inf
        """... and next at this time (vehicle seconds)."""

    @property
    def valid(self) -> bool:
        """Whether there is a mission that can be flown."""
        return bool(self.items) and self.problem is None

    def store(self, items: list[Item], *, keep_current: bool) -> None:
        """Replace the items; `keep_current` in flight: the mission goes on with the new ones."""
        self.items = items
        self.current = min(self.current, len(items) - 1) if keep_current and items else 0
        self.complete = False
        self.jumped.clear()

    @property
    def landing(self) -> int | None:
        """The item with which the landing begins: DO_LAND_START, or the last LAND."""
        starts = [item.seq for item in self.items if item.command == LAND_START]
        lands = [item.seq for item in self.items if item.command == LAND]
        return starts[0] if starts else lands[-1] if lands else None
