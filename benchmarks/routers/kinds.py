"""How many bytes one record of each kind takes on the link between two sites."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Final

from benchmarks.mail.boards import until
from benchmarks.routers.sites import BETWEEN_SITES, FLEET, Links, Site, probe
from commd.bus.bus import Bus, Query, open_bus
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Health, Perception, State
from schemas.wire.terms import Structure

TOGETHER: Final = 100
"""Messages of a batch."""
_ID: Final = "n2a0:0a1b2c3d:1"
"""Of an action."""
_STATES: Final[tuple[State, ...]] = ("accepted", "succeeded")


async def sizes(made: Site, counted: Links, idle: float, records: int) -> dict[str, float]:
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

        async def acts(query: Query[Action]) -> None:
            for state in _STATES:
                header, term = there.header("status"), Structure("at", (1.0, 2.0))
                query.reply(ActionStatus(header=header, id=_ID, state=state, name="goto", parameters=(term,)))

        async def actions() -> None:
            action = Action(header=here.header("actions"), id=_ID, agent="n2a0", name="goto")
            for _ in range(records):
                async for _reply in here.query(keys.action(FLEET, "rs2a0", "goto"), action, ActionStatus, 10):
                    pass

        await count("a percept, nobody listens there", records, percepts)
        await count("the health of a daemon, nobody listens there", records, healths)
        there.subscribe(keys.percept(FLEET, "rn2a0", "*"), Perception, lambda key, record: None)
        there.subscribe(keys.health(FLEET, "*", "*"), Health, lambda key, record: None)
        await count("a percept, somebody listens there", records, percepts)
        await count("the health of a daemon, somebody listens there", records, healths)
        there.serve(keys.action(FLEET, "rs2a0", "goto"), Action, acts)
        await count("an action and its two statuses", records, actions)
        await count("a key that a daemon there serves", records, declarations)
        await count("somebody who comes (a token)", records, tokens)
        found |= await _mail(made, counted, idle, records)
        return found


async def _nothing(query: Query[Action]) -> None:
    query.reply_error("nothing")


async def _mail(made: Site, counted: Links, idle: float, records: int) -> dict[str, float]:
    """Count the bytes of messages that are sent one at a time, and of those in batches."""
    async with probe(made, "n2") as sender, probe(made, "s2") as receiver:
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
