"""The MAVLink mission protocol of a vehicle: upload, download, clear."""

import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.ardupilot import telemetry
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.mission import KNOWN, goal_of
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.motion.tasks import GoTo
from bridged.simulation.vehicle.notifications import Severity

MAX_ITEMS = 700
"""Items that the vehicle stores; a longer mission is refused."""

_REPEAT_S = 1.0
_GIVE_UP_S = 8.0
"""Period and limit of repeated requests for a missing item, in seconds (recorded)."""

_ACCEPTED, _UNSUPPORTED, _NO_SPACE, _INVALID, _BAD_SEQUENCE, _CANCELLED = 0, 3, 4, 5, 13, 15
"""MISSION_ACK.type (MAV_MISSION_RESULT)."""

_GUIDED_ITEM = 2
"""MISSION_ITEM.current of a goal for GUIDED that is not part of a mission (dronekit's simple_goto)."""

Messages = list[dialect.MAVLink_message]


@dataclass(slots=True)
class _Upload:
    peer: tuple[int, int]
    count: int
    asked: float
    items: list[Item] = field(default_factory=list)
    heard: float = 0.0


class MissionProtocol:
    """Mission protocol with one upload at a time."""

    def __init__(self, copter: ArduPilot) -> None:
        self._copter = copter
        self._upload: _Upload | None = None

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Answer one message of the mission protocol."""
        peer = (message.get_srcSystem(), message.get_srcComponent())
        kind = message.get_type()
        if kind in ("MISSION_ITEM", "MISSION_ITEM_INT"):
            if message.current == _GUIDED_ITEM:
                return [self._guide(message, peer)]
            return self._take(message, peer)
        if getattr(message, "mission_type", 0) != 0:
            return self._other_list(message, peer, kind)
        match kind:
            case "MISSION_REQUEST_LIST":
                count = len(self._copter.mission.items) + (self._copter.home is not None)
                return [dialect.MAVLink_mission_count_message(*peer, count)]
            case "MISSION_REQUEST" | "MISSION_REQUEST_INT":
                return self._read(message.seq, peer, as_int=kind == "MISSION_REQUEST_INT")
            case "MISSION_COUNT":
                return self._begin(message.count, peer)
            case "MISSION_CLEAR_ALL":
                self._copter.mission.clear()
                self._copter.count_mission(0)
                return [dialect.MAVLink_mission_ack_message(*peer, _ACCEPTED)]
            case "MISSION_SET_CURRENT" if self._copter.jump_to(message.seq):  # else silence (ArduPilot)
                return [telemetry.mission_current(self._copter)]
        return []

    def advance(self) -> Messages:
        """Repeat the request for a missing item; give up in the end."""
        upload, now = self._upload, self._copter.now
        if upload is None:
            return []
        if now - upload.heard >= _GIVE_UP_S:
            self._upload = None
            self._copter.send_text("Mission upload timeout", Severity.WARNING)
            return [dialect.MAVLink_mission_ack_message(*upload.peer, _CANCELLED)]
        if now - upload.asked >= _REPEAT_S:
            return [self._ask(upload)]
        return []

    def _begin(self, count: int, peer: tuple[int, int]) -> Messages:
        if self._upload is not None and self._upload.peer != peer:
            return [dialect.MAVLink_mission_ack_message(*peer, _UNSUPPORTED)]
        if count > MAX_ITEMS:
            return [dialect.MAVLink_mission_ack_message(*peer, _NO_SPACE)]
        if count == 0:
            self._copter.mission.clear()
            self._copter.count_mission(0)
            return [dialect.MAVLink_mission_ack_message(*peer, _ACCEPTED)]
        now = self._copter.now
        self._upload = _Upload(peer, count, now, heard=now)
        return [self._ask(self._upload)]

    def _ask(self, upload: _Upload) -> dialect.MAVLink_message:
        upload.asked = self._copter.now
        return dialect.MAVLink_mission_request_message(*upload.peer, len(upload.items))

    def _take(self, message: dialect.MAVLink_message, peer: tuple[int, int]) -> Messages:
        upload = self._upload
        if upload is None or upload.peer != peer:
            return []
        if message.seq != len(upload.items):
            return [] if message.seq < len(upload.items) else [self._ask(upload)]
        item = _item_of(message)
        if item is None:
            self._upload = None
            return [dialect.MAVLink_mission_ack_message(*peer, _INVALID)]
        if item.command not in KNOWN:
            self._upload = None
            return [dialect.MAVLink_mission_ack_message(*peer, _UNSUPPORTED)]
        upload.items.append(item)
        upload.heard = self._copter.now
        if len(upload.items) > 1:
            self._copter.count_mission(len(upload.items))
        if len(upload.items) < upload.count:
            return [self._ask(upload)]
        self._upload = None
        self._copter.mission.store(upload.items)
        self._copter.send_text("Flight plan received")
        return [dialect.MAVLink_mission_ack_message(*peer, _ACCEPTED)]

    def _read(self, seq: int, peer: tuple[int, int], *, as_int: bool) -> Messages:
        copter = self._copter
        item = copter.mission.item(seq)
        if seq == 0 and copter.home is not None:
            home = copter.home
            item = Item(0, 0, dialect.MAV_CMD_NAV_WAYPOINT, (0, 0, 0, 0), home.lat_e7, home.lon_e7, home.alt)
        if item is None:
            return [dialect.MAVLink_mission_ack_message(*peer, _BAD_SEQUENCE)]
        current = int(seq == copter.mission.current and seq > 0)
        x, y = (item.x, item.y) if as_int else (item.x / 1e7, item.y / 1e7)
        kind = dialect.MAVLink_mission_item_int_message if as_int else dialect.MAVLink_mission_item_message
        return [kind(*peer, seq, item.frame, item.command, current, item.autocontinue, *item.params, x, y, item.z)]

    def _guide(self, message: dialect.MAVLink_message, peer: tuple[int, int]) -> dialect.MAVLink_message:
        item, copter = _item_of(message), self._copter
        goal = goal_of(item, copter.chart, copter.home or copter.chart.origin) if item is not None else None
        accepted = goal is not None and copter.mode is copter.GUIDED and copter.guide(GoTo(goal))
        return dialect.MAVLink_mission_ack_message(*peer, _ACCEPTED if accepted else _INVALID)

    def _other_list(self, message: dialect.MAVLink_message, peer: tuple[int, int], kind: str) -> Messages:
        """Answer requests for fence and rally lists, which stay empty."""
        mission_type = message.mission_type
        match kind:
            case "MISSION_REQUEST_LIST":
                return [dialect.MAVLink_mission_count_message(*peer, 0, mission_type)]
            case "MISSION_CLEAR_ALL":
                return [dialect.MAVLink_mission_ack_message(*peer, _ACCEPTED, mission_type)]
            case "MISSION_COUNT" | "MISSION_REQUEST" | "MISSION_REQUEST_INT":
                return [dialect.MAVLink_mission_ack_message(*peer, _UNSUPPORTED, mission_type)]
        return []


def _item_of(message: dialect.MAVLink_message) -> Item | None:
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        if not (math.isfinite(x) and math.isfinite(y) and abs(x) <= 180 and abs(y) <= 180):
            return None
        x, y = round(x * 1e7), round(y * 1e7)
    if not math.isfinite(message.z) or abs(message.z) > 100_000:
        return None
    first, second, third = (
        value if math.isfinite(value) else 0.0 for value in (message.param1, message.param2, message.param3)
    )
    params = (first, second, third, 0.0)
    if message.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:  # stored without a place (recorded)
        return Item(message.seq, 0, message.command, params, 0, 0, 0.0)
    return Item(message.seq, message.frame, message.command, params, x, y, message.z, int(bool(message.autocontinue)))
