"""The MAVLink mission protocol of a simulated vehicle: lists of items, uploaded, downloaded and cleared."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar, Generic

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.messages import A, Messages
from bridged.simulation.vehicle.mission_items import Item

MISSION, FENCE, RALLY = 0, 1, 2
"""mission_type (MAV_MISSION_TYPE)."""
_LISTS = frozenset((MISSION, FENCE, RALLY))
"""The lists that are stored; others stay empty."""
_COMMANDS = {FENCE: frozenset((5000, 5001, 5002, 5003, 5004)), RALLY: frozenset((5100,))}
"""Commands of the items of a fence, and of rally points."""
Peer = tuple[int, int]
"""System and component."""


class Ack(IntEnum):
    """type of MISSION_ACK (MAV_MISSION_RESULT)."""

    ACCEPTED = 0
    ERROR = 1
    BAD_FRAME = 2
    UNSUPPORTED = 3
    NO_SPACE = 4
    INVALID = 5
    BAD_SEQUENCE = 13
    DENIED = 14
    CANCELLED = 15


def peer_of(message: dialect.MAVLink_message) -> Peer:
    """Return whose message it is."""
    return message.get_srcSystem(), message.get_srcComponent()


@dataclass(slots=True)
class _Upload:
    peer: Peer
    kind: int
    count: int
    asked: float
    heard: float
    items: list[Item] = field(default_factory=list)


class MissionProtocol(ABC, Generic[A]):
    """Mission protocol with one upload at a time."""

    REPEAT_S: ClassVar[float]
    GIVE_UP_S: ClassVar[float]
    """Period and limit of repeated requests for a missing item, in vehicle seconds (recorded)."""
    MAX_ITEMS: ClassVar[int]
    """Items that the vehicle stores; a longer list is refused."""
    COMMANDS: ClassVar[Collection[int]]
    """Commands of the items of its missions."""
    BUSY: ClassVar[Ack]
    """Result for a second sender while an upload goes on."""
    NOT_STORED: ClassVar[Ack]
    """Result of a request for an item of a list that is not stored."""
    REQUEST: ClassVar[type[dialect.MAVLink_message]]
    """The message by which it requests an item."""

    def __init__(self, autopilot: A) -> None:
        self.autopilot = autopilot
        self._upload: _Upload | None = None

    @property
    def uploading(self) -> bool:
        """Whether items are requested."""
        return self._upload is not None

    @abstractmethod
    def _count(self, kind: int) -> int:
        """Return how many items a list has."""

    @abstractmethod
    def _item(self, seq: int, kind: int) -> tuple[Item, bool] | None:
        """Return an item by its number, and whether it is the current one; None if there is none."""

    @abstractmethod
    def _store(self, items: list[Item], kind: int) -> None:
        """Replace a list; no items clear it."""

    @abstractmethod
    def _read(self, message: dialect.MAVLink_message) -> Item | Ack:
        """Return the item in a message, or why it is refused."""

    @abstractmethod
    def _set_current(self, seq: int) -> Messages:
        """MISSION_SET_CURRENT"""

    def _knows(self, message: dialect.MAVLink_message) -> bool:
        """Return whether the command of an item is one of its list."""
        return message.command in _COMMANDS.get(message.mission_type, self.COMMANDS)

    def _partly_stored(self, count: int) -> None:
        """Note how many items of an upload have arrived."""

    def _refused(self) -> None:
        """Report that an item of an upload was refused."""

    @abstractmethod
    def _given_up(self, peer: Peer) -> Messages:
        """Report that a missing item did not come."""

    def receive(self, message: dialect.MAVLink_message) -> Messages:
        """Answer one message of the mission protocol."""
        peer, kind, name = peer_of(message), getattr(message, "mission_type", MISSION), message.get_type()
        match name:
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                return self._take(message, peer, kind)
            case "MISSION_REQUEST_LIST":
                return [dialect.MAVLink_mission_count_message(*peer, self._count(kind), kind)]
            case "MISSION_REQUEST" | "MISSION_REQUEST_INT":
                return [self._answer(message.seq, peer, kind, as_int=name == "MISSION_REQUEST_INT")]
            case "MISSION_COUNT":
                return [self._begin(message.count, peer, kind)]
            case "MISSION_CLEAR_ALL":
                self._store([], kind)
                return [ack(peer, Ack.ACCEPTED, kind)]
            case "MISSION_SET_CURRENT":
                return self._set_current(message.seq)
        return []

    def advance(self) -> Messages:
        """Repeat the request for a missing item; give up in the end."""
        upload, now = self._upload, self.autopilot.now
        if upload is None:
            return []
        if now - upload.heard >= self.GIVE_UP_S:
            self._upload = None
            return self._given_up(upload.peer)
        return [self._ask(upload)] if now - upload.asked >= self.REPEAT_S else []

    def _begin(self, count: int, peer: Peer, kind: int) -> dialect.MAVLink_message:
        if kind not in _LISTS:
            return ack(peer, Ack.UNSUPPORTED, kind)
        if count > self.MAX_ITEMS:
            return ack(peer, Ack.NO_SPACE, kind)
        if self._upload is not None and self._upload.peer != peer:
            return ack(peer, self.BUSY, kind)
        if count == 0:
            self._store([], kind)
            return ack(peer, Ack.ACCEPTED, kind)
        now = self.autopilot.now
        self._upload = _Upload(peer, kind, count, now, now)
        return self._ask(self._upload)

    def _ask(self, upload: _Upload) -> dialect.MAVLink_message:
        upload.asked = self.autopilot.now
        return self.REQUEST(*upload.peer, len(upload.items), upload.kind)

    def _take(self, message: dialect.MAVLink_message, peer: Peer, kind: int) -> Messages:
        upload = self._upload
        if upload is None or upload.peer != peer or kind != upload.kind:
            return []
        if message.seq != len(upload.items):
            return [] if message.seq < len(upload.items) else [self._ask(upload)]
        item = self._read(message)
        if isinstance(item, Ack):
            self._upload = None
            self._refused()
            return [ack(peer, item, kind)]
        upload.items.append(item)
        upload.heard = self.autopilot.now
        self._partly_stored(len(upload.items))
        if len(upload.items) < upload.count:
            return [self._ask(upload)]
        self._upload = None
        self._store(upload.items, kind)
        return [ack(peer, Ack.ACCEPTED, kind)]

    def _answer(self, seq: int, peer: Peer, kind: int, *, as_int: bool) -> dialect.MAVLink_message:
        if kind not in _LISTS:
            return ack(peer, self.NOT_STORED, kind)
        found = self._item(seq, kind)
        if found is None:
            return ack(peer, Ack.BAD_SEQUENCE, kind)
        item, current = found
        x, y = (item.x, item.y) if as_int else (item.x / 1e7, item.y / 1e7)
        build = dialect.MAVLink_mission_item_int_message if as_int else dialect.MAVLink_mission_item_message
        return build(
            *peer, seq, item.frame, item.command, int(current), item.autocontinue, *item.params, x, y, item.z, kind
        )


def parameters_of(message: dialect.MAVLink_message) -> tuple[float, float, float]:
    """Return param1 to param3 of an item, 0 for those that are no numbers."""
    first, second, third = (
        value if math.isfinite(value) else 0.0 for value in (message.param1, message.param2, message.param3)
    )
    return first, second, third


def ack(peer: Peer, result: Ack, kind: int = MISSION) -> dialect.MAVLink_message:
    """Return a MISSION_ACK."""
    return dialect.MAVLink_mission_ack_message(*peer, int(result), kind)
