"""Two sites of two boards each, every board with its own router, and links between them whose bytes are counted.

    n2 --- n1 === s1 --- s2        a link within a site: ---, the one link between the sites: ===

A router dials its neighbour by way of a TCP relay in this process, which counts what it passes.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.mail.boards import Member, member
from benchmarks.watched import Watched, watched
from tests.support.ports import free_port
from tests.support.relay import Relay

BOARDS: Final = ("n1", "n2", "s1", "s2")
LINKS: Final[Mapping[str, tuple[str, str]]] = {"n2-n1": ("n2", "n1"), "n1-s1": ("s1", "n1"), "s1-s2": ("s2", "s1")}
"""Each link, and who dials whom; in the order in which what n2 says comes to s2."""
BETWEEN_SITES: Final = "n1-s1"
FLEET: Final = "bench"
_ALTITUDES: Final = 100_000
"""So far apart are altitudes that the talkers are to remember: nobody asks for them here."""
_PROGRAM: Final = """\
seen(0).
!serve.
+!serve <- .wait(bridge(up), 300000); .print("serves").
+ask(Whom, Pause)[source(S)] <- -ask(Whom, Pause)[source(S)]; .random(R); .wait(R * Pause); !!ask(Whom, Pause).
+!ask(Whom, Pause) <- .send(Whom, askOne, seen(_), seen(_), 10000); .wait(Pause); !!ask(Whom, Pause).
-!ask(Whom, Pause) <- .print("no answer from ", Whom); .wait(Pause); !!ask(Whom, Pause).
"""


@dataclass(frozen=True)
class Site:
    """A mission on disk and what its boards need."""

    folder: Path
    mission: Path
    endpoints: dict[str, str]
    """Of each board's router."""
    listens: dict[str, str]
    """Where its neighbours reach it."""
    ports: dict[str, int]
    """Of the links of each board's vehicles."""
    each: int
    """Vehicles, with their agents, of a board."""

    def agents(self, board: str) -> list[str]:
        """Return the agents of a board."""
        return [f"{board}a{number}" for number in range(self.each)]


def site(folder: Path, each: int) -> Site:
    """Write a mission of so many UAVs on each of the four boards."""
    (folder / "asker.asl").write_text(_PROGRAM)
    made = Site(
        folder,
        folder / "sites.yaml",
        endpoints={board: f"tcp/127.0.0.1:{free_port()}" for board in BOARDS},
        listens={board: f"tcp/127.0.0.1:{free_port()}" for board in BOARDS},
        ports={board: free_port() for board in BOARDS},
        each=each,
    )
    lines = [f"mission: {FLEET}", "boards: {" + ", ".join(f"{board}: {{}}" for board in BOARDS) + "}", "agents:"]
    robots, number = ["robots:"], 0
    for board in BOARDS:
        for agent in made.agents(board):
            number += 1
            lines.append(f"  {agent}: {{program: asker.asl, board: {board}, robot: r{agent}}}")
            link = f"link: 'udpin:127.0.0.1:{made.ports[board]}', sysid: {number}"
            robots.append(f"  r{agent}: {{manifest: arducopter, board: {board}, {link}}}")
    probes = ", ".join(f"probe{board}: {{board: {board}}}" for board in BOARDS)
    made.mission.write_text("\n".join([*lines, *robots, f"clients: {{{probes}}}", ""]))
    return made


class Links:
    """The relays of the links."""

    def __init__(self, relays: Mapping[str, Relay]) -> None:
        self.relays = relays

    def passed(self) -> dict[str, tuple[int, int]]:
        """Return the bytes that each link has passed so far, from who dialled and back."""
        return {name: (relay.forth, relay.back) for name, relay in self.relays.items()}


@asynccontextmanager
async def links(made: Site) -> AsyncIterator[tuple[Links, dict[str, list[str]]]]:
    """Open the relays; yields them, and the `--listen` and `--connect` of each board's commd."""
    options = {board: ["--listen", made.listens[board]] for board in BOARDS}
    async with AsyncExitStack() as stack:
        relays = {}
        for name, (dials, dialled) in LINKS.items():
            relay = Relay(free_port(), int(made.listens[dialled].rpartition(":")[2]))
            relays[name] = await stack.enter_async_context(relay)
            options[dials] += ["--connect", f"tcp/127.0.0.1:{relay.port}"]
        yield Links(relays), options


@contextmanager
def routers(made: Site, options: Mapping[str, list[str]]) -> Iterator[dict[str, Watched]]:
    """Run a commd for each board; they end one after the other."""
    with ExitStack() as stack:
        found = {}
        for board in BOARDS:
            where = ("serve", str(made.mission), "--board", board, "--router", made.endpoints[board])
            state = ("--state", str(made.folder / board))
            found[board] = stack.enter_context(
                watched(f"commd {board}", "-m", "commd", *where, *state, *options[board])
            )
        for one in found.values():
            one.says("router board=")
        yield found


@contextmanager
def crews(made: Site) -> Iterator[list[Watched]]:
    """Run bridged and agentd for each board."""
    with ExitStack() as stack:
        found = []
        for board in BOARDS:
            where = ("serve", str(made.mission), "--board", board, "--router", made.endpoints[board])
            state = ("--state", str(made.folder / board))
            found += [
                stack.enter_context(watched(f"{kind} {board}", "-m", kind, *where, *state))
                for kind in ("bridged", "agentd")
            ]
        for one in found:
            one.says("agents=" if one.name.startswith("agentd") else "serving ")
        yield found


@contextmanager
def vehicles(made: Site, agent_group: list[Watched]) -> Iterator[None]:
    """Run all vehicles, which talk as copters in flight do, and wait until every agent serves its own."""
    where, number = [], 0
    for board in BOARDS:
        for _ in range(made.each):
            number += 1
            where.append(f"{number}:{made.ports[board]}")
    with watched("vehicles", "-m", "benchmarks.scale.talkers", str(_ALTITUDES), *where) as talkers:
        talkers.says("talking")
        for one in agent_group:
            if one.name.startswith("agentd"):
                one.says("] serves")
        yield


@asynccontextmanager
async def probe(made: Site, board: str) -> AsyncIterator[Member]:
    """Be a member of a board."""
    async with member(made.endpoints[board], f"probe{board}") as found:
        yield found


async def bytes_a_second(counted: Links, seconds: float) -> dict[str, float]:
    """Return what each link passes a second, both ways together."""
    before, begun = counted.passed(), asyncio.get_running_loop().time()
    await asyncio.sleep(seconds)
    after, took = counted.passed(), asyncio.get_running_loop().time() - begun
    return {name: (sum(after[name]) - sum(before[name])) / took for name in after}
