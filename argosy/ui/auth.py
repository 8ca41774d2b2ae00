"""Access to the page: only a browser with this run's token, from the page itself, by a host name that is ours.

A page in the operator's browser may send requests to loopback from anywhere in the web. So whatever does something or
shows something wants the cookie that the printed URL sets (SameSite=Strict: no other site's page sends it), the Host of
this server (no name that an attacker points here: DNS rebinding), and, for what does something, the Origin of our page.
"""

from __future__ import annotations

import hmac
import re
import secrets
import socket
from asyncio import BaseTransport
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from ipaddress import ip_address
from weakref import WeakSet

from aiohttp import web

from argosy.cli.port_check import is_loopback

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

POLICY = (
    "default-src 'self'; connect-src 'self' ws://{host}; img-src 'self' data:; object-src 'none'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'; trusted-types default"
)
"""Nothing from elsewhere, nothing inline, and no text is ever made markup (static/safe.js)."""
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[\w.-]+)(:[0-9]{1,5})?", re.ASCII)
"""Allowed `Host` headers: the header is copied into the policy above."""
STRANGER = "This page belongs to another run of `argosy ui`, or to none: open the address that `argosy ui` printed.\n"
ELSEWHERE = "refused: this request does not come from the page of `argosy ui`\n"
MISNAMED = "refused: `argosy ui` does not answer to the name {host}\n"


def host_of(request: web.Request) -> str:
    """Return the `Host` header; empty without one, where aiohttp's own waits for the name service."""
    return request.headers.get("Host", "")


@dataclass(frozen=True)
class AuthGuard:
    """The access rules of one run of the server."""

    listen: str
    """The host of `--listen`."""
    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)

    tickets: list[str] = field(default_factory=list, repr=False)
    """The token that opens once, if it was not used yet."""
    entered: WeakSet[BaseTransport] = field(default_factory=WeakSet, repr=False)
    """Connections that have shown this run's cookie."""

    @property
    def cookie(self) -> str:
        """Name of the cookie; browsers share cookies among the ports of a host, so the port is part of it."""
        return f"argosy_{self.port}"

    @property
    def url(self) -> str:
        """The address to open, with the token."""
        return self._address(self.token)

    def once(self) -> str:
        """Return an address that opens once only: it goes into a command line, which all users may read."""
        self.tickets[:] = [secrets.token_urlsafe(24)]
        return self._address(self.tickets[0])

    def _address(self, token: str) -> str:
        host = {"0.0.0.0": socket.gethostname(), "::": socket.gethostname()}.get(self.listen, self.listen)  # noqa: S104
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/?token={token}"

    def names(self, host: str) -> bool:
        """Whether a `Host` header names this server: an address cannot be pointed elsewhere, and other names are few.

        The port may be another one: somebody may reach us through an ssh tunnel.
        """
        found = HOST.fullmatch(host)
        if found is None:
            return False
        name = found["name"].strip("[]").lower()
        if name in ("localhost", self.listen.lower()):
            return True
        try:
            address = ip_address(name)
        except ValueError:
            own = socket.gethostname().lower()
            return not is_loopback(self.listen) and name in (own, f"{own}.local")
        return address.is_loopback or not is_loopback(self.listen)

    def knows(self, request: web.Request) -> bool:
        """Whether a request has this run's cookie."""
        return hmac.compare_digest(request.cookies.get(self.cookie, "").encode("utf-8", "replace"), self.token.encode())

    def is_ours(self, request: web.Request) -> bool:
        """Whether our own page made a request."""
        site = request.headers.get("Sec-Fetch-Site", "same-origin")
        return site == "same-origin" and request.headers.get("Origin") == f"http://{host_of(request)}"

    def enter(self, request: web.Request) -> web.StreamResponse | None:
        """Answer a request that shows the token: with the cookie, and the address without the token."""
        shown = request.query.get("token")
        if shown is None or request.path != "/" or not self._opens(shown.encode("utf-8", "replace")):
            return None
        answer = web.Response(status=303, headers={"Location": "/"})
        answer.set_cookie(self.cookie, self.token, httponly=True, samesite="Strict", path="/")
        return answer

    def _opens(self, shown: bytes) -> bool:
        if self.tickets and hmac.compare_digest(shown, self.tickets[0].encode()):
            self.tickets.clear()
            return True
        return hmac.compare_digest(shown, self.token.encode())

    @web.middleware
    async def guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Handle a request or refuse it with the reason; every answer has the security headers."""
        answer = await self._answer(request, handler)
        if not answer.prepared:
            answer.headers.update(HEADERS)
            answer.headers["Content-Security-Policy"] = POLICY.format(host=host_of(request))
            kept = isinstance(answer, web.FileResponse)  # the browser asks each time whether its copy still holds
            answer.headers["Cache-Control"] = "no-cache" if kept else "no-store"
        return answer

    async def _answer(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not self.names(host := host_of(request)):
            return web.Response(status=421, text=MISNAMED.format(host=host[:100]))
        entered = self.enter(request) if request.method == "GET" else None
        if entered is not None:
            return entered
        if not self.knows(request):
            return web.Response(status=401, text=STRANGER)
        if request.transport is not None:
            self.entered.add(request.transport)
        wants_more = request.method not in ("GET", "HEAD") or request.headers.get("Upgrade") is not None
        if wants_more and not self.is_ours(request):
            return web.Response(status=403, text=ELSEWHERE)
        try:
            return await handler(request)
        except web.HTTPException as refusal:  # 404, 405, 413 of aiohttp itself: an answer like any other
            return web.Response(status=refusal.status, text=f"{refusal.reason}\n")
