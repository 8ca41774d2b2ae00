"""The MAVLink mission protocol of a simulated ArduPilot."""

import math
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import telemetry
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.mission import KNOWN, goal_of
from bridged.simulation.vehicle.messages import Messages
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.mission_protocol import (
    MISSION,
    Ack,
    MissionProtocol,
    Peer,
    ack,
    parameters_of,
    peer_of,
)
from bridged.simulation.vehicle.motion.tasks import GoTo
from bridged.simulation.vehicle.notifications import Severity

_GUIDED_ITEM = 2
"""MISSION_ITEM.current of a goal for GUIDED that is not part of a mission (dronekit's simple_goto)."""


class ArduPilotMissions(MissionProtocol[ArduPilot]):
    """Missions of which item 0 is home; fences and rally points are stored, and have no effect."""

    REPEAT_S: ClassVar = 1.0
    GIVE_UP_S: ClassVar = 8.0
    MAX_ITEMS: ClassVar = 700
    COMMANDS: ClassVar = KNOWN
    BUSY: ClassVar = Ack.UNSUPPORTED
    NOT_STORED: ClassVar = Ack.UNSUPPORTED
    REQUEST: ClassVar = dialect.MAVLink_mission_request_message

    def __init__(self, autopilot: ArduPilot) -> None:
        super().__init__(autopilot)
        self._others: dict[int, list[Item]] = {}
        """Fence and rally points, by mission_type."""

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Answer one message of the mission protocol, or one goal for GUIDED."""
        if message.get_type() in ("MISSION_ITEM", "MISSION_ITEM_INT") and message.current == _GUIDED_ITEM:
            return [ack(peer_of(message), Ack.ACCEPTED if self._guide(message) else Ack.INVALID)]
        return super().receive(message)

    def _count(self, kind: int) -> int:
        if kind != MISSION:
            return len(self._others.get(kind, ()))
        return len(self.autopilot.mission.items) + (self.autopilot.home is not None)

    def _item(self, seq: int, kind: int) -> tuple[Item, bool] | None:
        if kind != MISSION:
            return next(((item, False) for item in self._others.get(kind, ()) if item.seq == seq), None)
        mission, home = self.autopilot.mission, self.autopilot.home
        if seq == 0 and home is not None:
            where = (home.lat_e7, home.lon_e7, home.alt)
            return Item(0, 0, dialect.MAV_CMD_NAV_WAYPOINT, (0, 0, 0, 0), *where), False
        item = mission.item(seq)
        return None if item is None else (item, seq == mission.current)

    def _store(self, items: list[Item], kind: int) -> None:
        if kind != MISSION:
            self._others[kind] = items
            return
        self.autopilot.mission.store(items)
        if items:
            self.autopilot.send_text("Flight plan received")
        else:
            self.autopilot.count_mission(0)

    def _partly_stored(self, count: int) -> None:
        if count > 1:
            self.autopilot.count_mission(count)

    def _given_up(self, peer: Peer) -> Messages:
        self.autopilot.send_text("Mission upload timeout", Severity.WARNING)
        return [ack(peer, Ack.CANCELLED)]

    def _set_current(self, seq: int) -> Messages:
        return [telemetry.mission_current(self.autopilot)] if self.autopilot.jump_to(seq) else []

    def _read(self, message: dialect.MAVLink_message) -> Item | Ack:
        x, y = message.x, message.y
        if message.get_type() == "MISSION_ITEM":
            if not (math.isfinite(x) and math.isfinite(y) and abs(x) <= 180 and abs(y) <= 180):
                return Ack.INVALID
            x, y = round(x * 1e7), round(y * 1e7)
        if not math.isfinite(message.z) or abs(message.z) > 100_000:
            return Ack.INVALID
        if not self._knows(message):
            return Ack.UNSUPPORTED
        params = (*parameters_of(message), 0.0)
        if message.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:  # stored without a place (recorded)
            return Item(message.seq, 0, message.command, params, 0, 0, 0.0)
        auto = int(bool(message.autocontinue))
        return Item(message.seq, message.frame, message.command, params, x, y, message.z, auto)

    def _guide(self, message: dialect.MAVLink_message) -> bool:
        """Fly to the place of an item in GUIDED; returns whether it does."""
        item, vehicle = self._read(message), self.autopilot
        goal = None if isinstance(item, Ack) else goal_of(item, vehicle.chart, vehicle.home or vehicle.chart.origin)
        return goal is not None and vehicle.mode is vehicle.GUIDED and vehicle.guide(GoTo(goal))
