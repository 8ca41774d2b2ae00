"""`argosy metrics`: the health of a fleet for Prometheus, over HTTP, on loopback unless told otherwise."""

from __future__ import annotations

import asyncio
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable
from contextlib import suppress
from ipaddress import ip_address

from argosy.exposition import exposition
from argosy.fleet_status import add_roll_arguments, call_the_roll
from argosy.operator_bus import ANY, Where, on_the_bus
from commd.bus import Bus
from commd.process import EXIT_BAD_INPUT, EXIT_FAILED
from schemas.endpoints import host_and_port
from schemas.findings import Findings
from schemas.mission import load_mission

LISTEN = "127.0.0.1:9464"
CALLERS = 16
"""Connections at once; further ones are closed."""
REQUEST_BYTES = 8_192
REQUEST_PATIENCE = 5.0
"""Wall seconds that a caller has to ask, and to take the answer."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy metrics`."""
    add_roll_arguments(parser)
    text = f"where /metrics is served (default {LISTEN}); any other machine that reaches it may read it"
    parser.add_argument("--listen", type=_address, metavar="HOST:PORT", default=LISTEN, help=text)


def run(args: Namespace) -> int:
    """Serve until ctrl-C."""
    if args.mission and args.fleet:
        print("error: argosy metrics: a mission has its fleet: leave out --fleet", file=sys.stderr)
        return EXIT_BAD_INPUT
    try:
        mission = load_mission(args.mission) if args.mission else None
    except Findings as findings:
        print(findings, file=sys.stderr)
        return EXIT_BAD_INPUT
    host, port = host_and_port(args.listen)

    async def serve(bus: Bus, where: Where) -> int:
        roll = call_the_roll(bus, where.fleet, mission)
        fleet = "" if where.fleet == ANY else where.fleet
        page = Page(lambda: exposition(fleet, roll.rows(), router_up=bus.router_up, dropped=roll.dropped))
        try:
            server = await asyncio.start_server(page.answer, host.strip("[]"), port, limit=REQUEST_BYTES)
        except OSError as error:
            print(f"error: cannot listen at {args.listen}: {error.strerror or error}", file=sys.stderr)
            return EXIT_FAILED
        print(f"serving http://{args.listen}/metrics", flush=True)
        if not _is_loopback(host):
            print(f"warning: whoever reaches {args.listen} reads it: no password, no TLS", file=sys.stderr)
        async with server:
            await server.serve_forever()
        return EXIT_FAILED

    return on_the_bus(args, serve)


class Page:
    """Answers `GET /metrics`, to a bounded number of callers at once."""

    def __init__(self, text: Callable[[], str]) -> None:
        self._text = text
        self.callers = 0

    async def answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer one request and close the connection."""
        self.callers += 1
        try:
            if self.callers <= CALLERS:
                async with asyncio.timeout(REQUEST_PATIENCE):
                    writer.write(self._answer_to(await reader.readuntil(b"\r\n\r\n")))
                    await writer.drain()
        except (TimeoutError, OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # who asks nothing, or does not read, is left
        finally:
            self.callers -= 1
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    def _answer_to(self, request: bytes) -> bytes:
        words = request.split(b"\r\n", 1)[0].split()
        if len(words) != 3 or words[0] not in (b"GET", b"HEAD"):
            return _response("405 Method Not Allowed", "expected GET\n")
        if words[1].split(b"?")[0] != b"/metrics":
            return _response("404 Not Found", "expected /metrics\n")
        found = _response("200 OK", self._text())
        return found if words[0] == b"GET" else found.partition(b"\r\n\r\n")[0] + b"\r\n\r\n"


def _response(status: str, text: str) -> bytes:
    body = text.encode(errors="replace")
    kind = "text/plain; version=0.0.4; charset=utf-8"
    head = f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    return head.encode() + body


def _address(text: str) -> str:
    try:
        host_and_port(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None
    return text


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"
