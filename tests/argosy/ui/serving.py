"""The server of `argosy ui` on a free port of loopback, and a browser of our own that knows its token, or does not."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import aiohttp

from argosy.cli.operator_bus import Where
from argosy.fleet_model.mission_clock import steady_clock
from argosy.ui.auth import AuthGuard
from argosy.ui.fleet_session import FleetSession
from argosy.ui.server import application, serving
from commd.bus.session import sessions_under_way, still_there
from schemas.mission.model import Mission
from tests.support.ports import free_port

NOWHERE = "tcp/127.0.0.1:9"
"""An endpoint at which there is no router."""


@dataclass
class Browser:
    """A client with a cookie jar, and what it is served by."""

    session: aiohttp.ClientSession
    auth: AuthGuard
    following: FleetSession

    @property
    def base(self) -> str:
        """Where the server is."""
        return f"http://127.0.0.1:{self.auth.port}"

    async def enter(self) -> None:
        """Open the printed address."""
        async with self.session.get(self.auth.url) as answer:
            assert answer.status == 200, await answer.text()

    async def get(self, path: str, **headers: str) -> tuple[int, str, Mapping[str, str]]:
        """Return status, body and headers."""
        async with self.session.get(self.base + path, headers=headers, allow_redirects=False) as answer:
            return answer.status, await answer.text(), answer.headers

    async def post(self, path: str, wish: object, **headers: str) -> tuple[int, str]:
        """Post as the page does, now, unless wish and `headers` say otherwise. Returns status and body."""
        if isinstance(wish, dict) and path in ("/stop", "/control"):
            wish = {"at": steady_clock()} | wish
        sent = {"Origin": self.base, "Content-Type": "application/json"} | headers
        data = wish if isinstance(wish, bytes) else json.dumps(wish).encode()
        async with self.session.post(self.base + path, data=data, headers=sent) as answer:
            return answer.status, await answer.text()

    @asynccontextmanager
    async def feed(self, *look: str, event: int = 0) -> AsyncIterator[Feed]:
        """Open the page's WebSocket."""
        async with self.session.ws_connect(f"{self.base}/feed", origin=self.base, max_msg_size=0) as socket:
            await socket.send_str(json.dumps({"look": list(look), "event": event}))
            yield Feed(socket)


class Feed:
    """What a page has heard."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.parts: dict[str, Any] = {}
        self.events: list[dict[str, Any]] = []
        self.sizes: list[int] = []
        self.left_out = 0

    async def hear(self) -> dict[str, Any]:
        """Take one message."""
        text = await asyncio.wait_for(self.socket.receive_str(), 90)
        self.sizes.append(len(text))
        news: dict[str, Any] = json.loads(text)
        self.parts.update(news.get("set", {}))
        for key in news.get("gone", ()):
            del self.parts[key]
        self.events += news.get("events", ())
        self.left_out += news.get("left_out", 0)
        return news

    async def hear_until(self, condition: Callable[[], object]) -> None:
        """Hear until something holds; fails after a bound."""
        async with asyncio.timeout(120):
            while not condition():
                await self.hear()

    async def until(self, key: str, **fields: object) -> dict[str, Any]:
        """Hear until a part has these fields; fails after a bound."""
        try:
            async with asyncio.timeout(240):
                while not (key in self.parts and fields.items() <= self.parts[key].items()):
                    await self.hear()
        except TimeoutError:
            raise AssertionError(f"not within 90 s: {key} has {fields}; it is {self.parts.get(key)}") from None
        return self.parts[key]  # type: ignore[no-any-return]


@asynccontextmanager
async def served(
    place: Where | None = None,
    mission: Mission | None = None,
    *,
    identity: str = "",
    listen: str = "127.0.0.1",
    tiles: Path | None = None,
) -> AsyncIterator[Browser]:
    """Serve a fleet; without a place nobody looks for a router."""
    before = sessions_under_way()  # one that another test has left, and Zenoh does not end, is not the page's
    auth = AuthGuard(listen, free_port())
    following = FleetSession(
        replace(place or Where("sar", NOWHERE), mission=mission), identity, tiles=tiles is not None
    )
    app, listening = application(auth, following, tiles), socket.create_server(("127.0.0.1", auth.port))
    listening.setblocking(False)
    link = asyncio.create_task(following.link.run()) if place is not None else None
    jar = aiohttp.CookieJar(unsafe=True)  # of an address
    try:
        async with (
            serving(app, auth, listening, leave=1.0),
            aiohttp.ClientSession(cookie_jar=jar) as session,
            asyncio.timeout(240),
        ):
            yield Browser(session, auth, following)
    finally:
        if link is not None:
            link.cancel()
            await asyncio.gather(link, return_exceptions=True)
        own = [one for one in sessions_under_way() if one not in before]
        assert not await asyncio.to_thread(still_there, own, 90)


@asynccontextmanager
async def entered(place: Where | None = None, mission: Mission | None = None, **options: Any) -> AsyncIterator[Browser]:
    """Serve a fleet to a browser that has opened the printed address; options as of `served`."""
    async with served(place, mission, **options) as browser:
        await browser.enter()
        yield browser
