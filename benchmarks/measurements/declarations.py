"""Part `declarations`: the declarations of a fleet of many boards, and their cost for routers and links.

Unit costs are measured with bare Zenoh routers, each a process of its own, in a chain: a board, a site's router where
there is one, and another board. A client of the first board declares; the number of these declarations at each router
is read in its admin space. The declarations of vehicles and boards are counted at the router of a real board. The rest
is calculated.

    python -m benchmarks.measurements.declarations MODE LISTEN [CONNECT]

runs such a router: `MODE` is `router`, or `region`, a client of `CONNECT` with a region of its own.
"""

from __future__ import annotations

import asyncio
import json
import math
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import zenoh

from benchmarks.measurements.fleet import start, wait_for_all, write_mission
from benchmarks.parts import progress, row, table
from benchmarks.processes import BenchmarkFailed, Watched, pss, watched
from benchmarks.results import Origin
from tests.support.ports import free_port
from tests.support.relay import Relay

COUNT: Final = 2000
"""Declarations of each kind."""
PUTS: Final = 2000
PUT_BYTES: Final = 300
"""Of a put: about those of a health record of ten agents."""
SETTLE: Final = 3.0
"""Seconds before and after something is declared: nothing else happens in them."""
PATIENCE: Final = 60.0
SIZES: Final = (1, 3)
"""Vehicles, each with its agent, whose declarations are counted."""
HEALTH: Final = "argosy/bench/board/health/agentd"
"""Key of the puts."""
BY_WILDCARD, BY_KEY = "put, heard by `argosy/bench/**`", "put, heard by its key"
HEARD: Final = {BY_WILDCARD: "argosy/bench/**", BY_KEY: HEALTH}
"""What the client of the other board subscribes to."""
SHARE: Final = 0.7
"""Of a core, from which on a router counts as outgrown."""
KINDS: Final = ("token", "queryable", "subscriber")
MESH, SITES, REGIONS = "each board linked with each", "a router for each site", "each board a region of its site"
TOPOLOGIES: Final = {MESH: ("router", False), SITES: ("router", True), REGIONS: ("region", True)}
"""The mode of a board's router, and whether a site's router is between two boards."""
FLEETS: Final = ((10, 10), (100, 10), (1000, 10))
"""Boards, and vehicles on each."""
SITE: Final = 50
"""Boards of a site."""


@dataclass
class Cost:
    """What one router does for a thousand declarations, or puts, of another board's client."""

    router: str
    held: int
    """Declarations that it has, of `COUNT`."""
    cpu: float
    """Seconds of processor time."""
    memory: float
    """MB."""


@dataclass
class Step:
    """What one kind costs in a topology."""

    topology: str
    kind: str
    """One of `KINDS` or of `HEARD`."""
    costs: list[Cost]
    link: float
    """Bytes for each on the link of the first board, both directions."""

    def of(self, router: str) -> Cost:
        """Return the cost of a router. Raises StopIteration."""
        return next(one for one in self.costs if one.router == router)


@dataclass
class Figures:
    """What was measured."""

    count: int
    steps: list[Step] = field(default_factory=list)
    few: list[Step] = field(default_factory=list)
    """What a quarter as many cost where each board is linked with each."""
    counted: dict[str, list[int]] = field(default_factory=dict)
    """By kind: declarations at the router of a board with each of `SIZES` vehicles."""

    def step(self, topology: str, kind: str) -> Step:
        """Return a step. Raises StopIteration."""
        return next(one for one in self.steps if (one.topology, one.kind) == (topology, kind))

    def vehicle(self, kind: str) -> float:
        """Return how many of a kind a vehicle and its agent declare."""
        few, many = self.counted[kind]
        return (many - few) / (SIZES[1] - SIZES[0])

    def board(self, kind: str) -> float:
        """Return how many of a kind a board without vehicles declares."""
        return self.counted[kind][0] - SIZES[0] * self.vehicle(kind)


def measure(quick: bool) -> Figures:
    """Measure everything. Raises BenchmarkFailed."""
    figures = Figures(50 if quick else COUNT)
    for topology in TOPOLOGIES:
        progress(topology)
        figures.steps += asyncio.run(_costs(topology, figures.count, 0.5 if quick else SETTLE))
    figures.few = asyncio.run(_costs(MESH, figures.count // 4, 0.5 if quick else SETTLE))
    for size in SIZES:
        for kind, number in _count_declarations(size).items():
            figures.counted.setdefault(kind, []).append(number)
    return figures


async def _costs(topology: str, count: int, settle: float) -> list[Step]:
    mode, has_site = TOPOLOGIES[topology]
    with ExitStack() as stack:
        here, there, site, relayed = (free_port() for _ in range(4))
        routers = {}
        if has_site:
            routers["site"] = stack.enter_context(_router("router", site))
        far = [site] if has_site else []
        routers["other board"] = stack.enter_context(_router(mode, there, *far))
        async with Relay(relayed, site if has_site else there) as relay:
            routers["board"] = await asyncio.to_thread(stack.enter_context, _router(mode, here, relayed))
            return await asyncio.to_thread(_declare_all, topology, routers, (here, there), relay, count, settle)


def _declare_all(
    topology: str, routers: dict[str, Watched], ports: tuple[int, int], relay: Relay, count: int, settle: float
) -> list[Step]:
    with _client(ports[0]) as near, _client(ports[1]) as far:
        names = [f"argosy/bench/agent{one}" for one in range(count)]
        acts: dict[str, Callable[[], Any]] = {
            "token": lambda: [near.liveliness().declare_token(f"{one}/alive/agentd/b") for one in names],
            "queryable": lambda: [near.declare_queryable(f"{one}/mind", lambda _: None) for one in names],
            "subscriber": lambda: [near.declare_subscriber(f"{one}/percepts", lambda _: None) for one in names],
        }
        steps, kept = [], []
        for kind, act in acts.items():
            found, made = _cost(topology, kind, routers, relay, count, settle, act)
            kept.append(made)
            for one in found.costs:
                one.held = _declarations_at(near if one.router == "board" else far, routers, one.router)[kind]
            steps.append(found)
        for kind, heard in HEARD.items():
            seen: list[zenoh.Sample] = []
            with far.declare_subscriber(heard, seen.append):
                time.sleep(settle)
                found, _ = _cost(topology, kind, routers, relay, PUTS, settle, partial(_put, near))
                if len(seen) < PUTS:
                    raise BenchmarkFailed(f"{topology}: {len(seen)} of {PUTS} puts arrived")
                steps.append(found)
        return steps


def _put(session: zenoh.Session) -> None:
    with session.declare_publisher(HEALTH, congestion_control=zenoh.CongestionControl.BLOCK) as publisher:
        for _ in range(PUTS):
            publisher.put(bytes(PUT_BYTES))


def _cost(
    topology: str,
    kind: str,
    routers: dict[str, Watched],
    relay: Relay,
    count: int,
    settle: float,
    act: Callable[[], Any],
) -> tuple[Step, Any]:
    """Measure something that is done `count` times, less what as long a time costs without it."""
    idle = {name: -one.cpu() for name, one in routers.items()}
    quiet = -(relay.forth + relay.back)
    time.sleep(settle)
    idle = {name: idle[name] + one.cpu() for name, one in routers.items()}
    quiet += relay.forth + relay.back
    before = {name: (one.cpu(), pss([one.process.pid])) for name, one in routers.items()}
    carried = relay.forth + relay.back
    begun = time.monotonic()
    made = act()
    time.sleep(settle)
    share = (time.monotonic() - begun) / settle
    costs = [
        Cost(
            name,
            0,
            1000 * (one.cpu() - before[name][0] - idle[name] * share) / count,
            1000 * (pss([one.process.pid]) - before[name][1]) / count,
        )
        for name, one in routers.items()
    ]
    return Step(topology, kind, costs, (relay.forth + relay.back - carried - quiet * share) / count), made


def _declarations_at(session: zenoh.Session, routers: dict[str, Watched], router: str) -> dict[str, int]:
    """Return how many declarations of the fleet a router has, by kind."""
    zid = routers[router].output[0][1].split()[-1]
    return {kind: _listed(session, f"@/{zid}/*/{kind}/argosy/**") for kind in KINDS}


def _listed(session: zenoh.Session, key: str) -> int:
    return sum(reply.ok is not None for reply in session.get(key, timeout=PATIENCE))


@contextmanager
def _router(mode: str, listen: int, *connect: int) -> Iterator[Watched]:
    arguments = ("-m", "benchmarks.measurements.declarations", mode, str(listen), *map(str, connect))
    with watched(f"router {listen}", *arguments) as process:
        process.wait_for("serves as")
        yield process


def _client(port: int) -> zenoh.Session:
    return zenoh.open(_config("client", [], [port]))


def _config(mode: str, listen: list[int], connect: list[int]) -> zenoh.Config:
    config = zenoh.Config()
    values: dict[str, Any] = {
        "mode": "client" if mode == "region" else mode,
        "scouting/multicast/enabled": False,
        "listen/endpoints": [f"tcp/127.0.0.1:{port}" for port in listen],
        "connect/endpoints": [f"tcp/127.0.0.1:{port}" for port in connect],
        "adminspace": {"enabled": True, "permissions": {"read": True, "write": False}},
    }
    if mode == "region":
        values["gateway"] = {"south": [{"filters": [{"modes": ["client", "peer"]}]}]}
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _count_declarations(size: int) -> dict[str, int]:
    """Return what a real board with so many vehicles and agents declares at its router, by kind."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        made = write_mission(folder, size, own_links=False)
        parts, begun = start(stack, folder, made)
        wait_for_all(size, parts, begun)
        time.sleep(SETTLE)
        with zenoh.open(_config("client", [], [int(made.router.rpartition(":")[2])])) as session:
            zid = str(next(iter(session.info.routers_zid())))
            return {kind: _listed(session, f"@/{zid}/router/{kind}/argosy/**") for kind in KINDS}


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/measurements/scaling.md."""
    lines = [
        origin.line(),
        "",
        "What a real board declares at its router:",
        "",
        *table("| | tokens | queryables | subscribers |"),
        row("a vehicle and its agent", *(f"{figures.vehicle(kind):.0f}" for kind in KINDS)),
        row("a board besides", *(f"{figures.board(kind):.0f}" for kind in KINDS)),
        "",
        f"What {figures.count:,} declarations of one board's client, and {PUTS:,} puts of {PUT_BYTES} bytes that one "
        "client of another board hears, cost each router (bare Zenoh, one process each):",
        "",
        *table("| links | what | router | has of them | µs each | kB each | bytes on the board's link, each |"),
    ]
    for step in figures.steps:
        for cost in step.costs:
            held, memory = (f"{cost.held:,}", f"{cost.memory:.1f}") if step.kind in KINDS else ("", "")
            costs = held, f"{1000 * cost.cpu:.0f}", memory, f"{step.link:.0f}"
            lines.append(row(step.topology, step.kind, cost.router, *costs))
    lines += [
        "",
        f"Calculated from these, with {SITE} boards on a site:",
        "",
        *table(
            "| boards, vehicles | links | router of | its links | declarations | memory | processor time, once "
            "| over a board's link, once | health over it |"
        ),
    ]
    for boards, each in FLEETS:
        for topology in TOPOLOGIES:
            lines += _calculated(figures, topology, boards, each)
    lines += ["", _growth(figures), "", _outgrown(figures)]
    return {"declarations": "\n".join(lines)}


def _growth(figures: Figures) -> str:
    """Return how the cost of a declaration grows with their number."""
    grown = ", ".join(
        f"a {kind} {1000 * few.of('other board').cpu:.0f} -> {1000 * many.of('other board').cpu:.0f} µs"
        for few, many in zip(figures.few, figures.steps, strict=False)
        if (kind := few.kind) in KINDS
    )
    return (
        f"A declaration costs more the more there are (the other board's router, {figures.count // 4:,} -> "
        f"{figures.count:,} of each kind: {grown}), so that the processor times above are least values."
    )


def _outgrown(figures: Figures) -> str:
    """Return when puts that cross routers for a wildcard outgrow the router that hears them."""
    each = max(one for _, one in FLEETS)
    declared = sum(figures.board(kind) + each * figures.vehicle(kind) for kind in KINDS)
    put = figures.step(MESH, BY_WILDCARD).of("other board").cpu / 1000 / (len(KINDS) * figures.count)
    boards = math.sqrt(SHARE / (3 * declared * put))
    return (
        f"A put for a wildcard costs the router of its listener {1e9 * put:.0f} ns for each declaration that it has. "
        f"Three health records a second of each board, heard by one such wildcard, take {SHARE:.0%} of a core there "
        f"at about {boards:.0f} boards of {each} vehicles."
    )


def _calculated(figures: Figures, topology: str, boards: int, each: int) -> Iterator[str]:
    """Yield the rows of a fleet: of a board's router, and of a site's if there is one."""
    _, has_site = TOPOLOGIES[topology]
    sites = max(1, boards // SITE)
    own = {kind: figures.board(kind) + each * figures.vehicle(kind) for kind in KINDS}
    everywhere = {kind: boards * own[kind] for kind in KINDS}
    # A region has its own declarations, and the tokens of all, which its commd watches.
    in_board = own | {"token": everywhere["token"]} if topology == REGIONS else everywhere
    unit = {kind: figures.step(MESH, kind) for kind in KINDS}

    def of_router(name: str, links: int, numbers: dict[str, float], *more: str) -> str:
        costs = {kind: unit[kind].of("other board") for kind in KINDS}
        memory = sum(number * costs[kind].memory / 1000 for kind, number in numbers.items())
        cpu = sum(number * costs[kind].cpu / 1000 for kind, number in numbers.items())
        held = f"{sum(numbers.values()):,.0f}", f"{memory:,.0f} MB", f"{cpu:,.1f} s"
        return row(f"{boards:,}, {boards * each:,}", topology, name, f"{links:,}", *held, *more)

    once = sum(number * unit[kind].link for kind, number in (in_board if has_site else own).items()) / 1000
    health = 3 * (boards if has_site else 1) * figures.step(topology, BY_WILDCARD).link / 1000
    links = 1 if has_site else boards - 1
    yield of_router("a board", links, in_board, f"{once:,.0f} kB", f"{health:,.1f} kB/s")
    if has_site:
        yield of_router("a site", min(SITE, boards) + sites - 1, everywhere, "", "")


def main(mode: str, listen: str, *connect: str) -> None:
    """Run a router until it is ended."""
    with zenoh.open(_config(mode, [int(listen)], [int(one) for one in connect])) as session:
        print("serves as", session.zid(), flush=True)
        signal.pause()


if __name__ == "__main__":
    main(*sys.argv[1:])
