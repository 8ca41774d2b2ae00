"""Says what a recording holds once more, on the bus, at the times at which it was said."""

from __future__ import annotations

import asyncio
from base64 import b64decode
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import msgspec

from argosy.recording.file import json_conversion
from argosy.recording.file.key_filter import fleet_of
from argosy.recording.file.reader import Recorded, Recording
from argosy.recording.file.records import TokenSeen, Unread, put_on
from commd.bus.bus import Bus, Token
from commd.bus.raw import Publisher
from schemas.wire import keys

AT_ONCE = 500
"""Messages that are said before the event loop turns to others."""
LATE = 0.25
"""Wall seconds by which it may be late without being told so."""


@dataclass
class Figures:
    """What a replay has done so far."""

    said: int = 0
    left_out: int = 0
    """Answers to questions that nobody puts, deleted keys, and what the recorder itself said."""
    not_ours: int = 0
    """What stands under keys that are none of a recorded fleet's: never said."""
    unreadable: int = 0
    """What is not what it says to be."""
    at: float = 0.0
    """Seconds of the recording."""
    behind: float = 0.0
    """Wall seconds by which it was late at worst."""


@dataclass(frozen=True)
class Part:
    """Which part of a recording is replayed, and how fast."""

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
    """From the name of a recorded fleet to the one in which it is replayed. Into no other anything is said."""
    figures: Figures = field(default_factory=Figures)
    tokens: dict[str, Token] = field(default_factory=dict)
    """Those that stand for recorded daemons now, by key."""
    declared: set[str] = field(default_factory=set)
    """All that ever stood for one: a token that was taken back is seen for a moment longer."""
    _publishers: dict[str, Publisher] = field(default_factory=dict)

    async def play(self, part: Part) -> None:
        """Say everything once, in real time; what was there before the beginning is said at once."""
        loop = asyncio.get_running_loop()
        for message in self._before(part):
            self._say(message)
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
            self._say(message)
        length = (part.end if part.end is not None else self.recording.seconds) - part.begin
        await asyncio.sleep(max(0.0, zero + length / part.speed - loop.time()))

    def clear(self) -> None:
        """Take back the tokens: the recorded daemons are there no longer."""
        for token in self.tokens.values():
            self.bus.withdraw(token)
        self.tokens.clear()

    def _before(self, part: Part) -> Iterator[Recorded]:
        """Yield the daemons that were there at the beginning, and the last that was said of each thing that lasts."""
        if part.begin <= 0:
            return
        last: dict[str, Recorded] = {}
        for message in self.recording.messages(None, part.begin, part.only):
            if message.origin == "token" and isinstance(token := message.record, TokenSeen):
                last.pop(token.key, None)
                if token.alive:
                    last[token.key] = message
            elif message.name in ("Perception", "LiveManifest", "BoardServices"):
                last[message.key] = message
        yield from last.values()

    def _say(self, message: Recorded) -> None:
        if message.origin == "token":
            self._token(message)
            return
        try:
            said = self._payload(message)
        except (ValueError, msgspec.MsgspecError, RecursionError):
            self.figures.unreadable += 1
            return
        if said is None:
            self.figures.left_out += 1
            return
        if (key := self._renamed(message.key)) is None:
            self.figures.not_ours += 1
            return
        publisher = self._publishers.get(key)
        if publisher is None:
            publisher = self._publishers[key] = self.bus.raw.publisher(key)
        publisher.put(said, message.track.encoding)
        self.figures.said += 1

    def _payload(self, message: Recorded) -> bytes | None:
        """Return the bytes that were put; None for what was not put, and is not."""
        if message.origin == "recorder" or (message.origin == "query" and not put_on(message.key)):
            return None
        if message.name == Unread.__name__:
            unread = message.record
            return b64decode(unread.base64) if isinstance(unread, Unread) and not unread.deleted else None
        return (
            json_conversion.to_msgpack(message.data)
            if json_conversion.is_msgpack(message.track.encoding)
            else message.data
        )

    def _token(self, message: Recorded) -> None:
        seen = message.record
        if not isinstance(seen, TokenSeen):
            self.figures.unreadable += 1
            return
        parsed, key = keys.parse(seen.key), self._renamed(seen.key)
        if key is None or parsed is None or len(parsed[2]) != 3 or parsed[2][0] != "alive":
            self.figures.not_ours += 1
        elif seen.alive and key not in self.tokens:
            self.declared.add(key)
            self.tokens[key] = self.bus.token(key)
        elif not seen.alive and key in self.tokens:
            self.bus.withdraw(self.tokens.pop(key))

    def _renamed(self, key: str) -> str | None:
        """Return the key in the fleet in which it is replayed; None for what is no plain key of a recorded one."""
        fleet = fleet_of(key)
        if fleet is None or fleet not in self.rename:
            return None
        _, _, rest = key.split("/", 2)
        return f"{keys.ROOT}/{self.rename[fleet]}/{rest}"


def foreign(tokens: Iterable[str], own: Iterable[str]) -> list[str]:
    """Return the names of daemons that are there and are none of the replay's."""
    parsed = (keys.parse(token) for token in sorted(set(tokens) - set(own)))
    return [f"{one[2][1]} {one[1]}" for one in parsed if one is not None and len(one[2]) == 3]
