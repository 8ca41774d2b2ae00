"""Cameras and gimbals that are components of a vehicle's system: which are there, and what is heard of them.

Their HEARTBEAT says that they are there, and nothing of the vehicle: mode, arming and link are the autopilot's alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from pymavlink.dialects.v20 import ardupilotmega as dialect

CAMERAS = range(dialect.MAV_COMP_ID_CAMERA, dialect.MAV_COMP_ID_CAMERA6 + 1)
GIMBALS = (dialect.MAV_COMP_ID_GIMBAL, *range(dialect.MAV_COMP_ID_GIMBAL2, dialect.MAV_COMP_ID_GIMBAL6 + 1))
PAYLOAD = frozenset((*CAMERAS, *GIMBALS))
"""MAVLink component ids."""
ATTACHED = range(1, 7)
"""Ids of cameras and gimbals that are attached to the autopilot, which speaks for them."""
MESSAGES = ("CAMERA_", "GIMBAL_", "VIDEO_", "STORAGE_")
"""Beginnings of the names of their messages that become percepts and confirm actions."""


class PayloadComponents:
    """The cameras and gimbals of one vehicle that are heard. Times are mission seconds."""

    def __init__(self) -> None:
        self._heard: dict[int, float] = {}

    def hear(self, component: int, now: float) -> None:
        """Take in that a component of `PAYLOAD` has spoken."""
        self._heard[component] = now

    def present(self, ids: Iterable[int], since: float) -> list[int]:
        """Return those of `ids` that have been heard since then."""
        return [one for one in ids if self._heard.get(one, -math.inf) >= since]
