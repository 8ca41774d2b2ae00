"""The WebSocket of one page: it is told what is new, at most four times a second, and says at which minds it looks."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress

import msgspec
from aiohttp import WSMsgType, web

from argosy.fleet_model import steady_clock
from argosy.ui.view_diff import Seen, Shown

PERIOD = 0.25
"""Wall seconds between two messages to a page."""
BEAT = 1.0
"""Wall seconds after which a page is told that we are there, though nothing is new."""
SLOW = 20.0
"""Wall seconds that a page has to take a message; then it is closed, and comes again by itself."""
WAITING_BYTES = 65_536
"""Of a page that takes nothing so much waits for it, then the next message is made only when there is room."""
FROM_PAGE = 4_096
"""Bytes of a message of a page."""
MINDS = 4
"""At so many minds a page may look at once."""


class Looks(msgspec.Struct, forbid_unknown_fields=True):
    """What a page tells: whose minds it shows, and up to which event it has all."""

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
        telling = asyncio.create_task(self._tell(socket))
        try:
            async for message in socket:
                if message.type is not WSMsgType.TEXT or not self._heard(message.data):
                    await socket.close(code=1008, message=b"expected {look: [agents]}")
        finally:
            telling.cancel()
            with suppress(asyncio.CancelledError, ConnectionError):
                await telling
        return socket

    def _heard(self, text: str) -> bool:
        try:
            looks = msgspec.json.decode(text, type=Looks)
        except msgspec.DecodeError:  # a ValidationError is one, too
            return False
        self.looks_at = tuple(dict.fromkeys(looks.look))[:MINDS]
        if not self._seen.begun and looks.event > 0:  # it lost us, and has what was before
            self._seen.event = looks.event
        self._hurry.set()
        return True

    async def _tell(self, socket: web.WebSocketResponse) -> None:
        """Send what is new, when the page has taken what was before."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self._hurry.wait(), 1.0)  # its first word says what it wants
        told = 0.0
        while not socket.closed:
            self._hurry.clear()
            self._refresh()
            now = steady_clock()
            message = self._shown.news(self._seen, self.looks_at, now)
            if len(message) > EMPTY or now - told >= BEAT:
                try:
                    async with asyncio.timeout(SLOW):
                        await socket.send_frame(message, WSMsgType.TEXT)
                except (TimeoutError, ConnectionError, RuntimeError):  # aiohttp raises the last one when it is closing
                    with suppress(Exception):
                        await socket.close(code=1008, message=b"too slow")
                    return
                told, self.sent = now, self.sent + len(message)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._hurry.wait(), PERIOD)


EMPTY = len('{"now":1234567890.123}')
"""Bytes of a message in which nothing is new."""
