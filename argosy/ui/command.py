"""`argosy ui`: arguments, the address that is printed, and the run of the server until ctrl-C."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
import sys
import time
import webbrowser
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from pathlib import Path
from typing import Any

import zenoh
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from argosy.cli.errors import BadInput, CommandError
from argosy.cli.operator_bus import add_fleet_arguments, where
from argosy.cli.port_check import is_loopback
from argosy.ui.auth import AuthGuard
from argosy.ui.fleet_session import FleetSession
from argosy.ui.server import application, serving
from commd.bus.tls import identity_of
from commd.process.log_handler import one_line
from commd.process.process import EXIT_DONE, on_end_signals

PORT = 8080
LISTEN = "127.0.0.1"
LEAVE = 1.0
"""Wall seconds to close the connections of pages at the end."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy ui`."""
    add_fleet_arguments(parser, "this fleet (default: the one on the router; with several, choose on the page)")
    help_ = f"TCP port of the page (default {PORT}; 0: any free port)"
    parser.add_argument("--port", type=_port, metavar="PORT", default=PORT, help=help_)
    help_ = f"address to listen at (default {LISTEN}: this machine only)"
    parser.add_argument("--listen", metavar="HOST", default=LISTEN, help=help_)
    parser.add_argument(
        "--tiles", type=Path, metavar="FOLDER", help="map tiles, FOLDER/Z/X/Y.png (default: a plain grid)"
    )
    parser.add_argument("--browser", action="store_true", help="open the page in this machine's browser")


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65_535:
        raise ArgumentTypeError(f"expected a port from 0 to 65535, got `{text}`")
    return int(text)


def run(args: Namespace) -> int:
    """Serve the page until ctrl-C or SIGTERM."""
    logging.getLogger("bus").setLevel(logging.ERROR)  # the page and the link report the router
    _log_defects_in_one_line(logging.getLogger("aiohttp.server"))
    if args.tiles is not None and not args.tiles.is_dir():
        raise BadInput(f"--tiles: {args.tiles} is not a folder")
    place = where(args)
    identity = identity_of(place.tls, time.time()).name if place.tls is not None else ""
    return asyncio.run(_serve(args, FleetSession(place, identity, tiles=args.tiles is not None)))


def _log_defects_in_one_line(log: logging.Logger) -> None:
    """Print an error of ours in one line, without a traceback unless `ARGOSY_DEBUG` is set."""

    class Line(logging.Handler):
        refused = 0

        def emit(self, record: logging.LogRecord) -> None:
            error = record.exc_info[1] if record.exc_info else None
            if isinstance(error, HttpProcessingError | web.RequestPayloadError):  # the request was not HTTP
                self.refused += 1
                if self.refused.bit_count() == 1:  # the 1st, 2nd, 4th, 8th: a flood fills no log
                    what = f"{self.refused} malformed requests so far, the last: {type(error).__name__}"
                    print(f"argosy ui: refused: {what}", file=sys.stderr, flush=True)
                return
            what = f"{type(error).__name__}: {error}" if error is not None else record.getMessage()
            print(f"argosy ui: defect: {one_line(what)}; ARGOSY_DEBUG=1 shows where", file=sys.stderr, flush=True)

    if not os.environ.get("ARGOSY_DEBUG") and not log.handlers:
        log.addHandler(Line(logging.ERROR))
        log.propagate = False


def _left_over(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Print an error of a background task in one line; the link already reports an unreachable router."""
    error = context.get("exception")
    if not isinstance(error, zenoh.ZError):
        what = f"{type(error).__name__}: {error}" if error is not None else context["message"]
        print(f"argosy ui: defect: {one_line(what)}", file=sys.stderr, flush=True)


async def _serve(args: Namespace, following: FleetSession) -> int:
    try:
        listening = await asyncio.to_thread(_socket, args.listen, args.port)
    except OSError as error:
        hint = "" if args.port == 0 else "; --port 0 takes any that is free"
        raise CommandError(
            f"cannot listen at {args.listen} port {args.port}: {error.strerror or error}{hint}"
        ) from None
    auth = AuthGuard(args.listen, listening.getsockname()[1])
    app = application(auth, following, args.tiles)
    stop = asyncio.Event()
    asyncio.get_running_loop().set_exception_handler(_left_over)
    on_end_signals(lambda _: stop.set())
    async with serving(app, auth, listening, LEAVE):
        link = asyncio.create_task(following.link.run())
        try:
            _print_address(args, auth)
            stopped = asyncio.create_task(stop.wait())
            done, _ = await asyncio.wait({stopped, link}, return_when=asyncio.FIRST_COMPLETED)
            stopped.cancel()
            if link in done:
                link.result()  # raises what made it end
            return EXIT_DONE
        finally:
            link.cancel()
            await asyncio.gather(link, return_exceptions=True)


def _socket(host: str, port: int) -> socket.socket:
    """Return a listening socket. Raises OSError."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    family, kind, protocol, _, address = found[0]
    listening = socket.socket(family, kind, protocol)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind(address)
        listening.listen(64)
        listening.setblocking(False)
    except BaseException:
        listening.close()
        raise
    return listening


def _print_address(args: Namespace, auth: AuthGuard) -> None:
    print(f"open {auth.url}", flush=True)
    if not is_loopback(args.listen):
        text = (
            "other machines can reach this page without TLS: whoever reads the address on the network can give orders"
        )
        print(f"warning: {text}", file=sys.stderr, flush=True)
    if args.browser:
        webbrowser.open(auth.once())
