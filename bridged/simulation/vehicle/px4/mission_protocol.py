"""The MAVLink mission protocol of a simulated PX4: missions and fences, uploaded, downloaded, cleared."""

import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.messages import Messages
from bridged.simulation.vehicle.mission_items import Item
from bridged.simulation.vehicle.notifications import MissionChanged
from bridged.simulation.vehicle.px4 import fence, missions
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.px4.texts import CRITICAL

MISSION, FENCE, RALLY = 0, 1, 2
"""mission_type (MAV_MISSION_TYPE)."""
MAX_ITEMS = 500
REPEAT_S, GIVE_UP_S = 0.25, 5.06
"""Period and limit of repeated requests for a missing item, in seconds (recorded)."""
_ACCEPTED, _ERROR, _BAD_FRAME, _UNSUPPORTED, _NO_SPACE, _BAD_SEQUENCE, _DENIED = 0, 1, 2, 3, 4, 13, 14
"""MISSION_ACK.type (MAV_MISSION_RESULT)."""
_FRAMES = frozenset((0, 2, 3, 5, 6))
"""Frames of items that are taken: places on the earth, and none."""


@dataclass(slots=True)
class _Upload:
    peer: tuple[int, int]
    kind: int
    count: int
    asked: float
    heard: float
    items: list[Item] = field(default_factory=list)


class MissionProtocol:
    """Mission protocol with one upload at a time."""

    def __init__(self, px4: Px4) -> None:
        self._px4 = px4
        self._upload: _Upload | None = None

    @property
    def uploading(self) -> bool:
        """Whether items are requested."""
        return self._upload is not None

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Answer one message of the mission protocol."""
        peer = (message.get_srcSystem(), message.get_srcComponent())
        kind = getattr(message, "mission_type", MISSION)
        match message.get_type():
            case "MISSION_ITEM_INT":
                return self._take(message, peer)
            case "MISSION_REQUEST_LIST":
                return [dialect.MAVLink_mission_count_message(*peer, len(self._items(kind)), kind)]
            case "MISSION_REQUEST_INT":
                return self._read(message.seq, peer, kind)
            case "MISSION_COUNT":
                return self._begin(message.count, peer, kind)
            case "MISSION_CLEAR_ALL":
                self._store([], kind)
                return [_ack(peer, _ACCEPTED, kind)]
            case "MISSION_SET_CURRENT" if not self._px4.navigator.jump_to(message.seq):
                self._px4.send_text("WPM: WP CURR CMD: Not in list", CRITICAL)
        return []

    def advance(self) -> Messages:
        """Repeat the request for a missing item; give up in the end, without an answer."""
        upload, now = self._upload, self._px4.now
        if upload is None:
            return []
        if now - upload.heard >= GIVE_UP_S:
            self._upload = None
            self._px4.send_text("Mission sync timeout", CRITICAL)
            return []
        return [self._ask(upload)] if now - upload.asked >= REPEAT_S else []

    def _items(self, kind: int) -> list[Item]:
        return {MISSION: self._px4.missions.items, FENCE: self._px4.fence.items}.get(kind, [])

    def _begin(self, count: int, peer: tuple[int, int], kind: int) -> Messages:
        if kind not in (MISSION, FENCE):
            return [_ack(peer, _UNSUPPORTED, kind)]
        if count > MAX_ITEMS:
            return [_ack(peer, _NO_SPACE, kind)]
        if self._upload is not None and self._upload.peer != peer:
            return [_ack(peer, _DENIED, kind)]
        if count == 0:
            self._store([], kind)
            return [_ack(peer, _ACCEPTED, kind)]
        now = self._px4.now
        self._upload = _Upload(peer, kind, count, now, now)
        return [self._ask(self._upload)]

    def _ask(self, upload: _Upload) -> dialect.MAVLink_message:
        upload.asked = self._px4.now
        return dialect.MAVLink_mission_request_int_message(*upload.peer, len(upload.items), upload.kind)

    def _take(self, message: dialect.MAVLink_message, peer: tuple[int, int]) -> Messages:
        upload = self._upload
        if upload is None or upload.peer != peer or message.mission_type != upload.kind:
            return []
        if message.seq != len(upload.items):
            return [] if message.seq < len(upload.items) else [self._ask(upload)]
        known = missions.KNOWN if upload.kind == MISSION else fence.COMMANDS
        result = (
            _BAD_FRAME if message.frame not in _FRAMES
            else _UNSUPPORTED if message.command not in known
            else _ACCEPTED if math.isfinite(message.z) and abs(message.z) < 100_000
            else _ERROR
        )  # fmt: skip
        if result != _ACCEPTED:
            self._upload = None
            self._px4.send_text("IGN MISSION_ITEM: Invalid item", CRITICAL)
            return [_ack(peer, result, upload.kind)]
        upload.items.append(_item_of(message))
        upload.heard = self._px4.now
        if len(upload.items) < upload.count:
            return [self._ask(upload)]
        self._upload = None
        self._store(upload.items, upload.kind)
        return [_ack(peer, _ACCEPTED, upload.kind)]

    def _store(self, items: list[Item], kind: int) -> None:
        px4 = self._px4
        if kind == FENCE:
            px4.fence.items = items
        elif kind == MISSION:
            px4.missions.store(items, keep_current=px4.flight.airborne)
        px4.navigator.judge()
        if kind == MISSION and items:
            px4.navigator.replaced()
        px4.events.append(MissionChanged())

    def _read(self, seq: int, peer: tuple[int, int], kind: int) -> Messages:
        items = self._items(kind)
        if not 0 <= seq < len(items):
            return [_ack(peer, _BAD_SEQUENCE, kind)]
        item = items[seq]
        current = int(seq == self._px4.missions.current) if kind == MISSION else int(seq == 0)
        return [
            dialect.MAVLink_mission_item_int_message(
                *peer, seq, item.frame, item.command, current, item.autocontinue, *item.params, item.x, item.y, item.z,
                kind,
            )
        ]  # fmt: skip


def _ack(peer: tuple[int, int], result: int, kind: int) -> dialect.MAVLink_message:
    return dialect.MAVLink_mission_ack_message(*peer, result, kind)


def _item_of(message: dialect.MAVLink_message) -> Item:
    params = tuple(
        value if math.isfinite(value) else default
        for value, default in (
            (message.param1, 0.0), (message.param2, 0.0), (message.param3, 0.0), (message.param4, math.nan),
        )
    )  # fmt: skip
    first, second, third, fourth = params
    frame = 5 if message.mission_type == FENCE else message.frame
    autocontinue = int(bool(message.autocontinue)) if message.mission_type != FENCE else 0
    return Item(
        message.seq, frame, message.command, (first, second, third, fourth), message.x, message.y, message.z,
        autocontinue,
    )  # fmt: skip
