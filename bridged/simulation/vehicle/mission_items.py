"""The mission that a vehicle stores, its items, and how numbers in messages are read."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

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


def whole(value: float) -> int:
    """A whole number from a field that any sender can fill with anything; -1 for what is none."""
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else -1


MOST_STEPS = 255
"""Items without a place that are searched for the next one with a place: bounds a mission of jumps alone."""


class StoredMission:
    """Items of a mission, and how far the vehicle is."""

    FIRST: ClassVar[int]
    """Number of the first item."""
    FLOWN: ClassVar[Collection[int]]
    """Commands (MAV_CMD) of items that are flown; others are done on the way."""

    def __init__(self) -> None:
        self.items: list[Item] = []
        self.current = 0
        self.complete = False
        self.entered_at = 0.0
        """When the current item began, or its place was reached, in vehicle seconds."""
        self.jumped: dict[int, int] = {}
        """How often each DO_JUMP has led back."""

    def rewind(self) -> None:
        """Let the mission begin with its first item the next time."""
        self.current, self.complete = 0, False
        self.jumped.clear()

    def item(self, seq: int) -> Item | None:
        """Return the item of this number."""
        at = seq - self.FIRST
        return self.items[at] if 0 <= at < len(self.items) else None

    def next_place(self, seq: int) -> tuple[list[Item], Item | None]:
        """Return what to do from item `seq` on, and then the next item to fly; None at the mission's end."""
        actions: list[Item] = []
        for _ in range(MOST_STEPS):
            item = self.item(seq)
            if item is None or item.command in self.FLOWN:
                return actions, item
            if item.command == dialect.MAV_CMD_DO_JUMP:
                seq = self._jump(item)
                continue
            actions.append(item)
            seq += 1
        return actions, None

    def _jump(self, item: Item) -> int:
        """Return where a DO_JUMP leads: to its item as often as it says (for ever if negative), then past it."""
        times = self.jumped.get(item.seq, 0)
        if 0 <= item.params[1] <= times or self.item(int(item.params[0])) is None:
            return item.seq + 1
        self.jumped[item.seq] = times + 1
        return int(item.params[0])
