"""The web server of `argosy ui`: the page and its files, one WebSocket for each open page, and what its buttons ask."""

from __future__ import annotations

import asyncio
import resource
import socket
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TypeVar

import msgspec
from aiohttp import web

from argosy.ui.auth import AuthGuard
from argosy.ui.fleet_session import FleetSession
from argosy.ui.page_requests import ControlWish, FleetWish, StopWish, WhyWish
from argosy.ui.view_diff import Page
from argosy.ui.view_structs import encoded

STATIC = Path(__file__).with_name("static")
REQUEST = 16_384
"""Bytes of what a page posts."""
PAGES = 16
"""Pages at the same time."""
STRANGERS = 400
"""Connections at the same time that have not shown the cookie; beyond that the oldest of them is closed."""
FULL = f"{PAGES} pages are open already: close one, then this one opens by itself\n"
W = TypeVar("W")


def application(auth: AuthGuard, following: FleetSession, tiles: Path | None = None) -> web.Application:
    """Return the server's application."""
    app = web.Application(middlewares=[auth.guard], client_max_size=REQUEST)
    pages, requests = following.pages, following.requests

    async def page(_request: web.Request) -> web.StreamResponse:
        return web.FileResponse(STATIC / "index.html")

    async def feed(request: web.Request) -> web.StreamResponse:
        if len(pages) >= PAGES:
            return web.Response(status=503, text=FULL)
        one = Page(following.shown, following.refresh)
        pages.add(one)
        try:
            return await one.serve(request)
        finally:
            following.left(one)

    async def here(_request: web.Request) -> web.Response:
        """Answer that this run is the one whose cookie the page has, or that there are too many pages."""
        return web.Response(status=503, text=FULL) if len(pages) >= PAGES else web.Response(text="here\n")

    app.router.add_get("/", page)
    app.router.add_get("/feed", feed)
    app.router.add_get("/here", here)
    app.router.add_post("/stop", _asked(StopWish, requests.stop))
    app.router.add_post("/control", _asked(ControlWish, requests.control))
    app.router.add_post("/why", _asked(WhyWish, requests.why))
    app.router.add_post("/fleet", _asked(FleetWish, requests.choose))
    app.router.add_static("/static", STATIC)
    if tiles is not None:
        app.router.add_static("/tiles", tiles)
    return app


@asynccontextmanager
async def serving(app: web.Application, auth: AuthGuard, listening: socket.socket, leave: float) -> AsyncIterator[None]:
    """Serve at a socket, without blocking, while the block lasts; open pages have `leave` wall seconds to close.

    Whoever can connect can hold connections without a word: they must not take the place of a page and its orders.
    """
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=leave)
    await runner.setup()
    server = runner.server
    assert server is not None
    most = min(STRANGERS, resource.getrlimit(resource.RLIMIT_NOFILE)[0] // 2)

    def accept() -> asyncio.Protocol:
        strangers = [one for one in server.connections if one.transport not in auth.entered]
        for one in strangers[: max(0, len(strangers) - most + 1)]:
            one.force_close()
        return server()

    accepting = await asyncio.get_running_loop().create_server(accept, sock=listening)
    try:
        yield
    finally:
        accepting.close()
        await runner.cleanup()


def _asked(
    wish: type[W], answer: Callable[[W], Awaitable[object]]
) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
    """Return a handler that decodes a request of type `wish` from JSON and answers in JSON."""
    decoder = msgspec.json.Decoder(wish)

    async def handle(request: web.Request) -> web.StreamResponse:
        if request.content_type != "application/json":
            return web.Response(status=415, text="expected application/json\n")
        try:
            asked = decoder.decode(await request.read())
        except (msgspec.DecodeError, UnicodeDecodeError) as bad:
            return web.Response(status=400, text=f"{bad}\n")
        return web.Response(body=encoded(await answer(asked)), content_type="application/json")

    return handle
