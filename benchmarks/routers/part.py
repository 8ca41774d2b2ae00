"""Part "routers": what crosses the links of a fleet of two sites with two boards each, and how much one router takes.

Every board has the daemons that it has in a fleet, and links to its neighbours alone (`benchmarks.routers.sites`).
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.mail.boards import until
from benchmarks.parts import Goal, tell
from benchmarks.routers import load as router_load
from benchmarks.routers import sites
from benchmarks.routers.load import Load
from benchmarks.routers.page import blocks, pictures
from benchmarks.routers.sites import BETWEEN_SITES, FLEET, Links, Site
from benchmarks.terminal import in_a_terminal
from commd.bus import Bus, Query, open_bus
from schemas import keys
from schemas.records import Action, ActionStatus, Health, Perception, State
from schemas.terms import Structure

__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

SECONDS: Final = 10.0
"""For which each stretch is looked at."""
SETTLE: Final = 4.0
EACH: Final = 3
"""UAVs of a board."""
RECORDS: Final = 200
"""Of a kind, whose bytes on the link are counted."""
RATES: Final = (1_000.0, 10_000.0, 30_000.0, 100_000.0, 0.0)
"""Percepts a second through one router."""
TOGETHER: Final = 100
"""Messages of a batch."""
ASK_EVERY: Final = 1.0
"""Seconds between the answer to an agent's question and its next one."""
SILENCE: Final = 0.02
"""So large a part of what percepts take with a listener may cross a link without one."""


@dataclass
class Stretch:
    """A time in which the fleet did one thing."""

    what: str
    seconds: float
    links: dict[str, float]
    """Bytes a second on each link, both ways together."""


@dataclass
class Figures:
    """What the part measures."""

    each: int = EACH
    """UAVs of a board."""
    ask_every: float = ASK_EVERY
    sizes: dict[str, float] = field(default_factory=dict)
    """Bytes on the link between the sites for one of a kind."""
    stretches: list[Stretch] = field(default_factory=list)
    starting: dict[str, int] = field(default_factory=dict)
    """Bytes on each link while all bridges and agents started: what they serve, hear and who they are is declared."""
    payload: int = 0
    """Bytes of the percept that the one router passes on."""
    loads: list[Load] = field(default_factory=list)

    def of(self, what: str) -> Stretch:
        """Return a stretch. Raises KeyError."""
        return {one.what: one for one in self.stretches}[what]


def measure(quick: bool) -> Figures:
    """Measure everything. Raises BenchmarkFailed."""
    figures = Figures(each=1 if quick else EACH, payload=len(router_load.payload()))
    figures.loads = router_load.measure(RATES[:2] if quick else RATES, 2.0 if quick else 6.0)
    with tempfile.TemporaryDirectory() as folder:
        asyncio.run(_of_sites(figures, Path(folder), 2.0 if quick else SECONDS, 20 if quick else RECORDS))
    return figures


async def _of_sites(figures: Figures, folder: Path, seconds: float, records: int) -> None:
    made = sites.site(folder, figures.each)
    async with sites.links(made) as (counted, options):
        with ExitStack() as stack:
            await asyncio.to_thread(stack.enter_context, sites.routers(made, options))
            await asyncio.sleep(SETTLE)
            await _look(figures, "routers and mail alone", counted, seconds)
            idle = figures.stretches[-1].links[BETWEEN_SITES]
            figures.sizes = await _sizes(made, counted, idle, records)
            before = counted.passed()
            crew = await asyncio.to_thread(stack.enter_context, sites.crews(made))
            await asyncio.sleep(SETTLE)
            figures.starting = {link: sum(now) - sum(before[link]) for link, now in counted.passed().items()}
            await _look(figures, "bridges and agents, no vehicle", counted, seconds)
            await asyncio.to_thread(stack.enter_context, sites.vehicles(made, crew))
            await asyncio.sleep(SETTLE)
            await _look(figures, "flying", counted, seconds)
            recorder = ("argosy", "record", "--router", made.endpoints["n2"], "--fleet", FLEET)
            await _with(figures, "flying, `argosy record` at n2", counted, seconds, *recorder, "-o", f"{folder}/a.mcap")
            watch = ("argosy", "watch", "--router", made.endpoints["n2"], "--fleet", FLEET)
            await _with(figures, "flying, `argosy watch` at n2", counted, seconds, *watch)
            page = ("argosy", "ui", "--router", made.endpoints["n2"], "--fleet", FLEET, "--port", "0")
            await _with(figures, "flying, `argosy ui` at n2", counted, seconds, *page)
            await _ask_across(made)
            await asyncio.sleep(SETTLE)
            await _look(figures, "flying, each agent asks one of the other site", counted, seconds)


async def _look(figures: Figures, what: str, counted: Links, seconds: float) -> None:
    figures.stretches.append(Stretch(what, seconds, await sites.bytes_a_second(counted, seconds)))
    shown = ", ".join(f"{link} {rate:.0f}" for link, rate in figures.stretches[-1].links.items())
    tell(f"{what}: {shown} bytes/s")


async def _with(figures: Figures, what: str, counted: Links, seconds: float, *command: str) -> None:
    """Look while a command of an operator runs."""
    with in_a_terminal(*command):
        await asyncio.sleep(2 * SETTLE)
        await _look(figures, what, counted, seconds)
    await asyncio.sleep(SETTLE)


async def _ask_across(made: Site) -> None:
    """Let each agent ask one of the other site, from now on."""
    across = {"n1": "s1", "n2": "s2", "s1": "n1", "s2": "n2"}
    for board, other in across.items():
        async with sites.probe(made, board) as probe:
            for agent, whom in zip(made.agents(board), made.agents(other), strict=True):
                await probe.post([agent], f"ask({whom}, {1000 * ASK_EVERY:g})")


# --- one of a kind ---


async def _sizes(made: Site, counted: Links, idle: float, records: int) -> dict[str, float]:
    """Count the bytes between the sites of one record of each kind, from n2 to s2."""
    async with _session(made, "n2") as here, _session(made, "s2") as there:
        found: dict[str, float] = {}

        async def count(what: str, number: int, work: Callable[[], Awaitable[None]]) -> None:
            await asyncio.sleep(1.0)
            begun, before = time.monotonic(), sum(counted.passed()[BETWEEN_SITES])
            await work()
            await asyncio.sleep(1.0)
            passed = sum(counted.passed()[BETWEEN_SITES]) - before - idle * (time.monotonic() - begun)
            found[what] = passed / number

        async def percepts() -> None:
            for number in range(records):
                header = here.header("percepts")
                pose = Perception(header=header, name="global_pos", parameters=(-27.604033, -48.518363 + number))
                here.put(keys.percept(FLEET, "rn2a0", "global_pos"), pose)
                await asyncio.sleep(0.005)

        async def healths() -> None:
            for _ in range(records):
                counters = {
                    f"percepts_{one}": 1234.0 for one in ("applied", "duplicates", "gaps", "missed", "repaired")
                }
                told = Health(header=here.header("health"), daemon="agentd", pid=4711, uptime=12.3, counters=counters)
                here.put(keys.health(FLEET, "n2a0", "agentd"), told)
                await asyncio.sleep(0.005)

        async def declarations() -> None:
            for number in range(records):
                there.serve(keys.mind(FLEET, f"x{number}"), Action, _nothing)
            await asyncio.sleep(1.0)

        async def tokens() -> None:
            for number in range(records):
                there.token(keys.alive(FLEET, f"x{number}", "client", there.boot))
            await asyncio.sleep(1.0)

        async def actions() -> None:
            action = Action(header=here.header("actions"), id="n2a0:0a1b2c3d:1", agent="n2a0", name="goto")
            for _ in range(records):
                async for _reply in here.query(keys.action(FLEET, "rs2a0", "goto"), action, ActionStatus, 10):
                    pass

        await count("a percept, nobody listens there", records, percepts)
        await count("the health of a daemon, nobody listens there", records, healths)
        there.subscribe(keys.percept(FLEET, "rn2a0", "*"), Perception, lambda key, record: None)
        there.subscribe(keys.health(FLEET, "*", "*"), Health, lambda key, record: None)
        await count("a percept, somebody listens there", records, percepts)
        await count("the health of a daemon, somebody listens there", records, healths)
        there.serve(keys.action(FLEET, "rs2a0", "goto"), Action, _acts)
        await count("an action and its two statuses", records, actions)
        await count("a key that a daemon there serves", records, declarations)
        await count("somebody who comes (a token)", records, tokens)
        found |= await _mail(made, counted, idle, records)
        return found


async def _nothing(query: Query[Action]) -> None:
    query.reply_error("nothing")


_STATES: Final[tuple[State, ...]] = ("accepted", "succeeded")


async def _acts(query: Query[Action]) -> None:
    for state in _STATES:
        header, term = query._bus.header("status"), Structure("at", (1.0, 2.0))
        query.reply(ActionStatus(header=header, id="n2a0:0a1b2c3d:1", state=state, name="goto", parameters=(term,)))


async def _mail(made: Site, counted: Links, idle: float, records: int) -> dict[str, float]:
    """Count the bytes of messages that are sent one at a time, and of those in batches."""
    async with sites.probe(made, "n2") as sender, sites.probe(made, "s2") as receiver:
        receiver.open()
        await asyncio.sleep(1.0)

        async def send(batch: int) -> float:
            begun, before = time.monotonic(), sum(counted.passed()[BETWEEN_SITES])
            for _ in range(0, records, batch):
                come = receiver.came[sender.name] + batch
                await sender.post([receiver.name] * batch)
                await until(lambda: receiver.came[sender.name] >= come, "mail comes", 60)  # noqa: B023 - at once
            await asyncio.sleep(0.5)
            return (sum(counted.passed()[BETWEEN_SITES]) - before - idle * (time.monotonic() - begun)) / records

        together = min(TOGETHER, records)
        return {
            "a message, with its receipt": await send(1),
            f"a message of {together} sent together": await send(together),
        }


@asynccontextmanager
async def _session(made: Site, board: str) -> AsyncIterator[Bus]:
    where = made.endpoints[board]
    async with open_bus(
        where, fleet=FLEET, name=f"count{board}", daemon="test", stamp=time.time_ns, patience=20
    ) as bus:
        yield bus


def goals(figures: Figures) -> list[Goal]:
    """What is asked: that percepts stay where nobody listens."""
    silent = figures.sizes["a percept, nobody listens there"]
    heard = figures.sizes["a percept, somebody listens there"]
    return [
        Goal(
            "percepts do not cross a link behind which nobody listens",
            f"{SILENCE:.0%} of their bytes at most",
            f"{silent / heard:.1%}",
            silent <= SILENCE * heard,
        )
    ]
