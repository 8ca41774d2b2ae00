"""`argosy metrics`: the health of a fleet for Prometheus, over HTTP, on loopback unless another address is given."""

from __future__ import annotations

import asyncio
import re
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from prometheus_client import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.core import Metric
from prometheus_client.registry import Collector

from argosy.cli.errors import CommandError
from argosy.cli.operator_bus import ANY, Where, on_the_bus
from argosy.cli.port_check import is_loopback
from argosy.fleet_model.fleet_status import FleetStatus, Row
from argosy.status.command import add_mission_arguments
from commd.bus.bus import Bus
from commd.process.process import EXIT_FAILED
from schemas.files.units import host_and_port
from schemas.wire.records import Health

LISTEN = "127.0.0.1:9464"
CALLERS = 16
"""Connections at the same time; further ones are closed."""
REQUEST_BYTES = 8_192
REQUEST_PATIENCE = 5.0
"""Wall seconds that a caller has to ask, and to take the answer."""

_HOST = re.compile(rb"\r\nhost:[ \t]*(\[[^\]\r]*\]|[^:\r]*)", re.ASCII | re.IGNORECASE)
"""The header of a request that names its server."""
COUNTERS = 100
"""Counters of one daemon that are exported; further ones are left out."""
FIGURES: tuple[tuple[str, str, Callable[[Health], float | None]], ...] = (
    ("argosy_uptime_seconds", "Seconds since the daemon started.", lambda one: one.uptime),
    ("argosy_cpu_seconds_total", "Processor time of its process.", lambda one: one.cpu),
    ("argosy_lag_seconds", "Seconds by which it is behind.", lambda one: one.lag),
    ("argosy_drops_total", "What its queues have dropped.", lambda one: one.drops),
    ("argosy_bad_input_total", "Input that did not decode.", lambda one: one.bad_input),
    ("argosy_errors_total", "Errors that it has logged.", lambda one: one.errors),
    ("argosy_restarts", "Starts after an end that nobody ordered.", lambda one: one.restarts),
    ("argosy_notes", "Warnings that hold now.", lambda one: len(one.notes)),
)
"""Name, help and value of each figure of a health record; `_total` makes it a counter."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy metrics`."""
    add_mission_arguments(parser)
    text = f"address of /metrics (default {LISTEN}); every machine that reaches it can read it"
    parser.add_argument("--listen", type=_address, metavar="HOST:PORT", default=LISTEN, help=text)


def run(args: Namespace) -> int:
    """Serve until ctrl-C."""
    host, port = host_and_port(args.listen)

    async def serve(bus: Bus, where: Where) -> int:
        fleet_status = FleetStatus.of_bus(bus, where.fleet, where.mission)
        fleet = "" if where.fleet == ANY else where.fleet
        local = is_loopback(host)
        page = Page(lambda: Fleet(fleet, fleet_status.rows(), bus.router_up, fleet_status.dropped).page(), local=local)
        try:
            server = await asyncio.start_server(page.answer, host.strip("[]"), port, limit=REQUEST_BYTES)
        except OSError as error:
            raise CommandError(f"cannot listen at {args.listen}: {error.strerror or error}") from None
        print(f"serving http://{args.listen}/metrics", flush=True)
        if not local:
            print(
                f"warning: everyone who reaches {args.listen} can read the metrics: no password, no TLS",
                file=sys.stderr,
            )
        async with server:
            await server.serve_forever()
        return EXIT_FAILED

    return on_the_bus(args, serve)


class Page:
    """Answers `GET /metrics`, to a bounded number of callers at the same time."""

    def __init__(self, text: Callable[[], bytes], *, local: bool = True) -> None:
        """`local`: only this machine reaches it, by its own names: others' may be pointed here by a web page."""
        self._text, self._local = text, local
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
            pass  # the caller did not ask, or did not read
        finally:
            self.callers -= 1
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()

    def _answer_to(self, request: bytes) -> bytes:
        words = request.split(b"\r\n", 1)[0].split()
        if len(words) != 3 or words[0] not in (b"GET", b"HEAD"):
            return _response("405 Method Not Allowed", b"expected GET\n")
        if words[1].split(b"?")[0] != b"/metrics":
            return _response("404 Not Found", b"expected /metrics\n")
        if self._local and (host := _HOST.search(request)) is not None and not is_loopback(host[1].decode("latin-1")):
            return _response("421 Misdirected Request", b"expected the name of this machine: localhost or 127.0.0.1\n")
        found = _response("200 OK", self._text())
        return found if words[0] == b"GET" else found.partition(b"\r\n\r\n")[0] + b"\r\n\r\n"


def _response(status: str, body: bytes) -> bytes:
    kind = CONTENT_TYPE_PLAIN_0_0_4
    head = f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    return head.encode() + body


def _address(text: str) -> str:
    try:
        host_and_port(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None
    return text


@dataclass(frozen=True)
class Fleet(Collector):
    """The health of a fleet at one time."""

    name: str
    rows: Sequence[Row]
    router_up: bool
    dropped: int = 0
    """Tokens and records of daemons beyond those that are observed."""

    def page(self) -> bytes:
        """Return it in Prometheus' text format, version 0.0.4."""
        return generate_latest(self)

    def collect(self) -> Iterator[Metric]:
        """Yield each metric with its samples."""
        fleet = {"fleet": self.name}
        reported = [(self._labels(row), row.age or 0.0, row.now) for row in self.rows if row.now is not None]
        yield _metric("argosy_router_up", "Whether the router answers this exporter.", [(fleet, self.router_up)])
        beyond = "Tokens and records of daemons beyond those that are observed."
        yield _metric("argosy_not_followed_total", beyond, [(fleet, self.dropped)])
        up = [(self._labels(row), row.standing == "up") for row in self.rows]
        yield _metric("argosy_up", "Whether a daemon is there and reports its health.", up)
        ages = [(labels, age) for labels, age, _ in reported]
        yield _metric("argosy_record_age_seconds", "Seconds since a daemon's last health record.", ages)
        versions = [(labels | {"version": health.version}, 1) for labels, _, health in reported]
        yield _metric("argosy_info", "Version of a daemon.", versions)
        for name, text, value in FIGURES:
            yield _metric(name, text, [(labels, value(health)) for labels, _, health in reported])
        counters = [
            (labels | {"counter": name}, health.counters[name])
            for labels, _, health in reported
            for name in sorted(health.counters)[:COUNTERS]
        ]
        yield _metric("argosy_counter", "A figure of a daemon's own: see docs/guides/monitoring.md.", counters)

    def _labels(self, row: Row) -> dict[str, str]:
        return {"fleet": row.fleet or self.name, "board": row.board, "daemon": row.daemon, "name": row.name}


def _metric(name: str, text: str, samples: Sequence[tuple[dict[str, str], float | None]]) -> Metric:
    """Return a counter if `name` ends in `_total`, else a gauge; samples without a value are left out."""
    family = Metric(name.removesuffix("_total"), text, "counter" if name.endswith("_total") else "gauge")
    for labels, value in samples:
        if value is not None:
            family.add_sample(name, labels, value)
    return family
