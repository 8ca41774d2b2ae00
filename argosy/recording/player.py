"""Publish a recording on the bus again, at the recorded times, and show its minds to those who ask."""

from __future__ import annotations

import asyncio
from base64 import b64decode
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

import msgspec
from msgspec.structs import replace

from agentd.conversion.mind_view import BadParameter, Look, MindViews
from agentd.extensions.plugins import discover
from agentd.replay.replayed_mind import CannotReplay, ReplayedMind
from argosy.recording.reader import Recorded, Recording
from argosy.recording.records import TokenSeen, Unread, fleet_of, is_msgpack, record_put_on, to_msgpack
from commd.bus.bus import Bus, Query, Token
from commd.bus.raw import Publisher
from schemas.wire import keys
from schemas.wire.codec import BadRecord, codec
from schemas.wire.mind_records import ActivityEvent, MindActivity, MindInputs, MindView
from schemas.wire.records import Header, Record

AT_ONCE = 500
"""Messages published before the event loop turns to other tasks."""
_OF_MINDS = (MindInputs.__name__, MindActivity.__name__)
LATE = 0.25
"""Wall seconds of delay that are not reported."""


@dataclass
class Figures:
    """Counters of a replay."""

    republished: int = 0
    """Messages published."""
    left_out: int = 0
    """Answers to queries, deleted keys, and the recorder's notes."""
    not_ours: int = 0
    """Messages on keys outside the recorded fleets: never published."""
    unreadable: int = 0
    """Messages that do not decode."""
    at: float = 0.0
    """Seconds of the recording."""
    behind: float = 0.0
    """Largest delay, in wall seconds."""


@dataclass(frozen=True)
class Part:
    """The part of a recording to replay, and the speed."""

    begin: float = 0.0
    """Seconds since its beginning."""
    end: float | None = None
    only: tuple[str, ...] = ()
    speed: float = 1.0


@dataclass
class Player:
    """Replays a recording on a bus."""

    bus: Bus
    recording: Recording
    rename: Mapping[str, str]
    """From the name of each recorded fleet to the fleet it is replayed into; nothing is published elsewhere."""
    figures: Figures = field(default_factory=Figures)
    tokens: dict[str, Token] = field(default_factory=dict)
    """Held tokens of recorded daemons, by key."""
    declared: set[str] = field(default_factory=set)
    """Keys of all tokens ever held: a withdrawn token stays visible for a moment."""
    minds: dict[str, PlayedMind] = field(default_factory=dict)
    """By the keys that they serve."""
    _publishers: dict[str, Publisher] = field(default_factory=dict)

    async def play(self, part: Part) -> None:
        """Publish the part once, in real time, beginning with the state that held before it."""
        loop = asyncio.get_running_loop()
        for message in self._before(part):
            self._republish(message)
        self.figures.at = part.begin
        zero, count = loop.time(), 0
        for message in self.recording.messages(part.begin, part.end, part.only):
            due = zero + (message.seconds - part.begin) / part.speed  # not from one to the next: errors would add up
            wait = due - loop.time()
            if wait > 0 or (count := count + 1) >= AT_ONCE:
                count = 0
                await asyncio.sleep(max(0.0, wait))
            self.figures.behind = max(self.figures.behind, loop.time() - due)
            self.figures.at = message.seconds
            self._republish(message)
        length = (part.end if part.end is not None else self.recording.seconds) - part.begin
        await asyncio.sleep(max(0.0, zero + length / part.speed - loop.time()))

    def clear(self) -> None:
        """Withdraw the tokens of the recorded daemons, and forget the minds."""
        for token in self.tokens.values():
            self.bus.withdraw(token)
        for mind in self.minds.values():
            mind.withdraw()
        self.tokens.clear()
        self.minds.clear()

    def _before(self, part: Part) -> Iterator[Recorded]:
        """Yield the tokens that were held at the beginning, and the last value of each lasting record."""
        if part.begin <= 0:
            return
        last: dict[str, Recorded] = {}
        for message in self.recording.messages(None, part.begin, part.only):
            if message.origin == "token" and isinstance(token := message.record, TokenSeen):
                last.pop(token.key, None)
                if token.alive:
                    last[token.key] = message
            elif message.name in _OF_MINDS:
                self._mind(message)
            elif message.name in ("Perception", "LiveManifest", "BoardServices"):
                last[message.key] = message
        yield from last.values()

    def _republish(self, message: Recorded) -> None:
        if message.origin == "token":
            self._token(message)
            return
        if message.name in _OF_MINDS:
            self._mind(message)
        try:
            payload = self._payload(message)
        except (ValueError, msgspec.MsgspecError, RecursionError):
            self.figures.unreadable += 1
            return
        if payload is None:
            self.figures.left_out += 1
            return
        if (key := self._renamed(message.key)) is None:
            self.figures.not_ours += 1
            return
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._publishers[key] = self.bus.raw.publisher(key)
        publisher.put(payload, message.track.encoding)
        self.figures.republished += 1

    def _payload(self, message: Recorded) -> bytes | None:
        """Return the bytes that were put; None for a message that was not put."""
        if message.origin == "recorder" or (message.origin == "query" and not record_put_on(message.key)):
            return None
        if message.name == Unread.__name__:
            unread = message.record
            return b64decode(unread.base64) if isinstance(unread, Unread) and not unread.deleted else None
        return to_msgpack(message.data) if is_msgpack(message.track.encoding) else message.data

    def _mind(self, message: Recorded) -> None:
        """Give a mind what was published of it."""
        parsed = keys.parse(self._renamed(message.key) or "")
        if parsed is not None:
            key = keys.mind(*parsed[:2])
            if key not in self.minds:
                self.minds[key] = PlayedMind(self.bus, key)
            self.minds[key].take(message)

    def _token(self, message: Recorded) -> None:
        seen = message.record
        if not isinstance(seen, TokenSeen):
            self.figures.unreadable += 1
            return
        key = self._renamed(seen.key)
        if key is None or keys.parse_alive(key) is None:
            self.figures.not_ours += 1
        elif seen.alive and key not in self.tokens:
            self.declared.add(key)
            self.tokens[key] = self.bus.token(key)
        elif not seen.alive and key in self.tokens:
            self.bus.withdraw(self.tokens.pop(key))

    def _renamed(self, key: str) -> str | None:
        """Return the key in the fleet it is replayed into; None for a key outside the recorded fleets."""
        fleet = fleet_of(key)
        if fleet is None or fleet not in self.rename:
            return None
        _, _, rest = key.split("/", 2)
        return f"{keys.ROOT}/{self.rename[fleet]}/{rest}"


def foreign(tokens: Iterable[str], own: Iterable[str]) -> list[str]:
    """Return the daemons, as `bridged uav1`, whose tokens are not the replay's own."""
    parsed = map(keys.parse_alive, sorted(set(tokens) - set(own)))
    return [f"{one[2]} {one[1]}" for one in parsed if one is not None]


MOST_ACTIONS: Final = 60
"""Last actions and outcomes that a view has."""


class _Which(Record, frozen=True, kw_only=True):
    """The header of a record of a mind, decoded without the rest, which may not be needed."""

    header: Header = Header()
    number: int = 0


class PlayedMind:
    """Answers queries for views of one agent's mind as the agent did, one start after the other.

    It is rebuilt from its recorded inputs, as far as these are published, when a query comes.
    """

    def __init__(self, bus: Bus, key: str) -> None:
        self.withdraw: Callable[[], None] = bus.serve(key, MindView, self._show, observers=True)
        self._bus, self._key, self._boot = bus, key, ""
        self._waiting: dict[int, bytes] = {}
        """The inputs that were not fed yet, by number, as the recording has them."""
        self._broken = ""
        """Why this mind cannot be replayed further; empty = it can."""
        self._actions: deque[ActivityEvent] = deque(maxlen=MOST_ACTIONS)
        self._rebuilt: tuple[ReplayedMind, MindViews] | None = None

    def take(self, message: Recorded) -> None:
        """Take what was published of the mind."""
        try:
            which = codec(_Which).decode(message.data)
        except BadRecord:
            return  # a later batch shows that one is missing
        if which.header.boot != self._boot:
            self._boot, self._rebuilt, self._broken = which.header.boot, None, ""
            self._waiting.clear()
            self._actions.clear()
        if message.name == MindInputs.__name__:
            if self._rebuilt is None or which.number > self._rebuilt[0].number:
                self._waiting[which.number] = message.data
        elif isinstance(record := message.record, MindActivity):
            self._actions += [event for event in record.events if event.kind in ("action", "outcome")]

    async def _show(self, query: Query[MindView]) -> None:
        try:
            view = self._view(Look.of(query.parameters))
        except (BadParameter, CannotReplay) as bad:
            query.reply_error(str(bad))
        else:
            await query.answer(replace(view, header=self._bus.header("mind", view.agent)), self._key)

    def _view(self, look: Look) -> MindView:
        """Return the mind after all inputs so far. Raises CannotReplay."""
        if self._rebuilt is None:
            if 0 not in self._waiting:
                raise CannotReplay("its start is not in the recording")
            discover()
            rebuilt = ReplayedMind(_inputs(self._waiting[0]))
            self._rebuilt = rebuilt, MindViews(rebuilt.mind)
        rebuilt, views = self._rebuilt
        if self._broken:
            raise CannotReplay(self._broken)
        try:
            while (batch := self._waiting.pop(rebuilt.number + 1, None)) is not None:
                rebuilt.feed(_inputs(batch))
        except CannotReplay as bad:
            self._broken = str(bad)
            raise
        if self._waiting:
            rebuilt.take(_inputs(self._waiting[min(self._waiting)]))  # raises: the batches before it are missing
        return replace(views.view(look, rebuilt.now), actions=tuple(self._actions))


def _inputs(batch: bytes) -> MindInputs:
    """Decode a batch. Raises CannotReplay."""
    try:
        return codec(MindInputs).decode(batch)
    except BadRecord as bad:
        raise CannotReplay(f"a batch of its inputs cannot be read: {bad}") from None
