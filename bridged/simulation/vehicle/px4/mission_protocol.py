"""The MAVLink mission protocol of a simulated PX4: missions and fences."""

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.messages import Messages
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.mission_protocol import (
    FENCE,
    MISSION,
    RALLY,
    Ack,
    MissionProtocol,
    Peer,
    parameters_of,
)
from bridged.simulation.vehicle.notifications import MissionChanged
from bridged.simulation.vehicle.px4 import missions
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.texts import CRITICAL

_FRAMES = frozenset((0, 2, 3, 5, 6))
"""Frames of items that are taken: places on the earth, and none."""


class Px4Missions(MissionProtocol[Px4]):
    """Missions whose items count from 0, without home, fences, and rally points, which have no effect."""

    REPEAT_S: ClassVar = 0.25
    GIVE_UP_S: ClassVar = 5.06
    MAX_ITEMS: ClassVar = 500
    COMMANDS: ClassVar = missions.KNOWN
    BUSY: ClassVar = Ack.DENIED
    NOT_STORED: ClassVar = Ack.BAD_SEQUENCE
    REQUEST: ClassVar = dialect.MAVLink_mission_request_int_message

    def __init__(self, autopilot: Px4) -> None:
        super().__init__(autopilot)
        self._rally: list[Item] = []

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Answer one message of the mission protocol; those in degrees are ignored."""
        return [] if message.get_type() in ("MISSION_ITEM", "MISSION_REQUEST") else super().receive(message)

    def _items(self, kind: int) -> list[Item]:
        return {MISSION: self.autopilot.missions.items, FENCE: self.autopilot.fence.items}.get(kind, self._rally)

    def _count(self, kind: int) -> int:
        return len(self._items(kind))

    def _item(self, seq: int, kind: int) -> tuple[Item, bool] | None:
        items, current = self._items(kind), self.autopilot.missions.current if kind == MISSION else 0
        return (items[seq], seq == current) if 0 <= seq < len(items) else None

    def _store(self, items: list[Item], kind: int) -> None:
        px4 = self.autopilot
        if kind == FENCE:
            px4.fence.items = items
        elif kind == RALLY:
            self._rally = items
        elif kind == MISSION:
            px4.missions.store(items, keep_current=px4.flight.airborne)
        px4.navigator.judge()
        if kind == MISSION and items:
            px4.navigator.replaced()
        px4.events.append(MissionChanged())

    def _refused(self) -> None:
        self.autopilot.send_text("IGN MISSION_ITEM: Invalid item", CRITICAL)

    def _given_up(self, peer: Peer) -> Messages:
        self.autopilot.send_text("Mission sync timeout", CRITICAL)
        return []

    def _set_current(self, seq: int) -> Messages:
        if not self.autopilot.navigator.jump_to(seq):
            self.autopilot.send_text("WPM: WP CURR CMD: Not in list", CRITICAL)
        return []

    def _read(self, message: dialect.MAVLink_message) -> Item | Ack:
        fenced = message.mission_type == FENCE
        if message.frame not in _FRAMES:
            return Ack.BAD_FRAME
        if not self._knows(message):
            return Ack.UNSUPPORTED
        if not math.isfinite(message.z) or abs(message.z) >= 100_000:
            return Ack.ERROR
        yaw = message.param4 if math.isfinite(message.param4) else math.nan
        frame, auto = (5, 0) if fenced else (message.frame, int(bool(message.autocontinue)))
        params = (*parameters_of(message), yaw)
        return Item(message.seq, frame, message.command, params, message.x, message.y, message.z, auto)
