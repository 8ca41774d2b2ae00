"""The parts that pages show, each with a key, and the WebSocket that sends a page the parts that have changed.

Nothing waits for a page: a slow one gets the present state when it is ready, and the events that the timeline keeps.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import msgspec
from aiohttp import WSMsgType, web

from argosy.fleet_model.mission_clock import steady_clock
from argosy.fleet_model.timeline import Entry, Timeline
from argosy.ui.view_structs import encoded
from commd.common.tasks import wait_at_most

AT_FIRST = 600
"""Events that a new page is sent."""
AT_ONCE = 250
"""Events of one message; the next messages have the rest."""
OF_MINDS, OF_PLANS = "mind/", "plans/"
"""Prefixes of parts that only go to pages that look at that agent."""
PERIOD = 0.25
"""Wall seconds between two messages to a page."""
BEAT = 1.0
"""Wall seconds between two messages if nothing is new."""
SLOW = 20.0
"""Wall seconds that a page has to take a message; then it is closed, and connects again by itself."""
WAITING_BYTES = 65_536
"""Bytes that wait for a page before the next message is made."""
FROM_PAGE = 4_096
"""Bytes of a message of a page."""
MINDS = 4
"""Minds that a page may look at."""


@dataclass
class Seen:
    """State of one page."""

    turn: int = 0
    parts: set[str] = field(default_factory=set)
    event: int = 0
    """Number of the newest event that it has."""
    begun: bool = False


class Shown:
    """The parts as JSON, and the turn in which each was last changed; and the events of a timeline."""

    def __init__(self, timeline: Timeline, at_first: Callable[[], object] = dict) -> None:
        """`at_first` returns the flown tracks, which a page gets when it opens and when a run begins."""
        self.turn = 0
        self._timeline, self._at_first, self._run_began = timeline, at_first, 1
        self.parts: dict[str, tuple[int, bytes]] = {}

    def begin_run(self) -> None:
        """Send the tracks again with the next message: those of the run before are over."""
        self._run_began = self.turn + 1

    def show(self, parts: Mapping[str, object]) -> None:
        """Replace all parts."""
        self.turn += 1
        for key in self.parts.keys() - parts.keys():
            del self.parts[key]
        for key, part in parts.items():
            data = encoded(part)
            if key not in self.parts or self.parts[key][1] != data:
                self.parts[key] = (self.turn, data)

    def add(self, parts: Mapping[str, object]) -> None:
        """Replace some parts; the others stay."""
        self.turn += 1
        for key, part in parts.items():
            self.parts[key] = (self.turn, encoded(part))

    def news(self, seen: Seen, looks_at: Collection[str], now: float) -> bytes:
        """Return a message with the news for a page, as JSON, and update `seen`. `now` is in Unix seconds."""
        changed, wanted = list[bytes](), set[str]()
        for key, (turn, data) in self.parts.items():
            if key.startswith((OF_MINDS, OF_PLANS)) and key.partition("/")[2] not in looks_at:
                continue
            wanted.add(key)
            if turn > seen.turn or key not in seen.parts:
                changed.append(encoded(key) + b":" + data)
        fields = [b'"now":' + encoded(round(now, 3))]
        fields += [b'"tracks":' + encoded(self._at_first())] if seen.turn < self._run_began else []
        gone = encoded(sorted(seen.parts - wanted)) if seen.parts - wanted else b""
        events, left_out = self._events(seen)
        seen.turn, seen.parts = self.turn, wanted
        fields += [b'"set":{' + b",".join(changed) + b"}"] if changed else []
        fields += [b'"gone":' + gone] if gone else []
        fields += [b'"events":' + encoded(events)] if events else []
        fields += [b'"left_out":' + encoded(left_out)] if left_out else []
        return b"{" + b",".join(fields) + b"}"

    def _events(self, seen: Seen) -> tuple[list[Entry], int]:
        if not seen.begun:
            seen.begun, seen.event = True, max(seen.event, self._timeline.number - AT_FIRST, 0)
        some = self._timeline.since(seen.event)[:AT_ONCE]
        left_out = some[0].number - seen.event - 1 if some else 0
        seen.event += left_out + len(some)
        return some, left_out


class Looks(msgspec.Struct, forbid_unknown_fields=True):
    """Message of a page: whose minds it shows, and the last event that it has."""

    look: list[str] = []
    event: int = 0


class Page:
    """One open page."""

    def __init__(self, shown: Shown, refresh: Callable[[], None]) -> None:
        self._shown, self._refresh = shown, refresh
        self.looks_at: tuple[str, ...] = ()
        self._seen = Seen()
        self._hurry = asyncio.Event()
        self.sent = 0
        """Bytes."""

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        """Serve the page until it goes."""
        socket = web.WebSocketResponse(
            heartbeat=15, compress=False, max_msg_size=FROM_PAGE, writer_limit=WAITING_BYTES, timeout=2.0
        )
        await socket.prepare(request)
        sending = asyncio.create_task(self._send_news(socket))
        try:
            async for message in socket:
                if message.type is not WSMsgType.TEXT or not self._heard(message.data):
                    await socket.close(code=1008, message=b"expected {look: [agents]}")
        finally:
            sending.cancel()
            with suppress(asyncio.CancelledError, ConnectionError):
                await sending
        return socket

    def _heard(self, text: str) -> bool:
        try:
            looks = msgspec.json.decode(text, type=Looks)
        except msgspec.DecodeError:  # a ValidationError is one, too
            return False
        self.looks_at = tuple(dict.fromkeys(looks.look))[:MINDS]
        if not self._seen.begun and looks.event > 0:  # it lost the connection, and has the events before
            self._seen.event = looks.event
        self._hurry.set()
        return True

    async def _send_news(self, socket: web.WebSocketResponse) -> None:
        """Send the news whenever the page has taken the last message."""
        await wait_at_most(self._hurry, 1.0)  # for its first message
        sent_at = 0.0
        while not socket.closed:
            self._hurry.clear()
            self._refresh()
            now = steady_clock()
            message = self._shown.news(self._seen, self.looks_at, now)
            if len(message) > EMPTY or now - sent_at >= BEAT:
                try:
                    async with asyncio.timeout(SLOW):
                        await socket.send_frame(message, WSMsgType.TEXT)
                except (TimeoutError, ConnectionError, RuntimeError):  # aiohttp raises the last one when it is closing
                    with suppress(Exception):
                        await socket.close(code=1008, message=b"too slow")
                    return
                sent_at, self.sent = now, self.sent + len(message)
            await wait_at_most(self._hurry, PERIOD)


EMPTY = len('{"now":1234567890.123}')
"""Bytes of a message in which nothing is new."""
