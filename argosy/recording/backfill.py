"""Fetch what a recorder did not receive: the state before it started, and inputs of minds that were lost.

Percepts, manifests, directories and mailboxes are published when they change, and the inputs of a mind only while there
is a subscriber: a recorder that starts late queries them.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Iterable

import msgspec
import zenoh

from argosy.recording.mind_inputs import Minds, Whose, range_text, stretches
from argosy.recording.records import TokenSeen
from argosy.recording.write_queue import Heard, WriteQueue
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.common.tasks import Tasks
from schemas.wire import keys
from schemas.wire.codec import BadRecord, codec
from schemas.wire.mind_records import MindInputs, MindView
from schemas.wire.records import BoardServices, LiveManifest, Mailboxes, Perception, Record

PATIENCE = 5.0
"""Wall seconds to wait for answers."""
SETTLE = 0.3
"""Wall seconds between a token and a query: a daemon declares its token before it serves."""
AGAIN = (0.3, 1.0, 3.0)
"""Wall seconds before each query for an agent's inputs; repeated until it answers."""
LOOK = 1.0
"""Wall seconds between two checks for missing batches."""
TRIES = 3
"""Maximum number of queries for the same missing batches of a mind."""
AT_ONCE = 8
"""Concurrent queries."""
REPLIES = 100_000
"""Queued replies to one query."""
log = logging.getLogger("recorder")


def token_seen(key: str, alive: bool, at: int) -> Heard | None:
    """Return what is recorded of a daemon's token that appears or ends, at Unix nanoseconds; None for another key."""
    if (parsed := keys.parse_alive(key)) is None:
        return None
    fleet, name, daemon, _ = parsed
    payload = msgspec.json.encode(TokenSeen(key=key, alive=alive))
    return Heard(at, f"{keys.ROOT}/{fleet}/{name}/alive/{daemon}", payload, codec(TokenSeen).encodings["json"], "token")


class Backfill:
    """Follows the tokens of a fleet and queries each daemon that appears."""

    def __init__(self, bus: Bus, fleet: str, write_queue: WriteQueue, minds: Minds, only: Iterable[str] = ()) -> None:
        """`fleet` may be `*`. `only`: key expressions; nothing else is queried."""
        self.tokens = 0
        """Daemons with a token."""
        self._bus, self._fleet, self._write_queue, self._minds = bus, fleet, write_queue, minds
        self._only = [zenoh.KeyExpr(key) for key in only]
        self._tasks = Tasks("asking for what was before")
        self._room = asyncio.Semaphore(AT_ONCE)
        self._tried: dict[Whose, tuple[frozenset[int], int]] = {}
        self._perceiving: set[str] = set()
        """Fleets whose percepts will be queried soon."""

    def start(self) -> None:
        """Begin to follow the fleet."""
        self._bus.watch(keys.alive(self._fleet, "*", "*", "*"), self._token)
        self._tasks.spawn(self._repair())

    async def close(self) -> None:
        """Stop querying."""
        await self._tasks.end()

    async def last_look(self) -> None:
        """Query missing batches once more, before the end."""
        for whose in self._minds.missing():
            if self._tried.get(whose, (frozenset(), 0))[1] < TRIES:
                await self._inputs(whose.fleet, whose.agent)

    def look_again(self) -> None:
        """Query everything that may have changed while the router was away."""
        self._perceive(self._fleet)
        self._tried.clear()

    def _token(self, key: str, alive: bool) -> None:
        self.tokens += 1 if alive else -1
        if (parsed := keys.parse_alive(key)) is None:
            return
        fleet, name, daemon, _ = parsed
        seen = token_seen(key, alive, self._write_queue.now())
        if seen is not None and self._wants(keys.alive(fleet, name, daemon, "*")):
            self._write_queue.put(seen)
        if not alive:
            return
        match daemon:
            case "agentd":
                self._tasks.spawn(self._mind(fleet, name))
            case "bridged":
                self._perceive(fleet)
                self._spawn_ask(keys.manifest(fleet, name), LiveManifest)
            case "commd":
                self._spawn_ask(keys.services(fleet, name), BoardServices)
                self._spawn_ask(keys.mailboxes(fleet, name), Mailboxes)

    def _perceive(self, fleet: str) -> None:
        """Query all percepts of a fleet in `LOOK` seconds, once for several bridges."""
        if fleet not in self._perceiving:
            self._perceiving.add(fleet)
            self._tasks.spawn(self._percepts(fleet))

    async def _percepts(self, fleet: str) -> None:
        await asyncio.sleep(LOOK)
        self._perceiving.discard(fleet)
        await self._ask(f"{keys.ROOT}/{fleet}/*/percept/**", Perception)

    async def _mind(self, fleet: str, agent: str) -> None:
        if self._wants(keys.mind(fleet, agent)):
            self._spawn_ask(f"{keys.mind(fleet, agent)}?plans=true", MindView)
        if not self._wants(keys.trace(fleet, agent, "inputs")):
            return
        for seconds in AGAIN:
            await asyncio.sleep(seconds)
            if await self._inputs(fleet, agent):
                return

    async def _inputs(self, fleet: str, agent: str) -> bool:
        return await self._ask(keys.trace(fleet, agent, "inputs"), MindInputs)

    async def _repair(self) -> None:
        """Query missing batches, `TRIES` times each."""
        while True:
            await asyncio.sleep(LOOK)
            for whose, numbers in self._minds.missing().items():
                before, tries = self._tried.get(whose, (frozenset(), 0))
                tries = tries if numbers <= before else 0
                if tries >= TRIES or not self._wants(keys.trace(whose.fleet, whose.agent, "inputs")):
                    continue
                self._tried[whose] = numbers, tries + 1
                await self._inputs(whose.fleet, whose.agent)
                if tries + 1 == TRIES and (left := self._minds.missing().get(whose)):
                    log.warning("%s: batches %s of its inputs are lost", whose.agent, range_text(stretches(left)))

    def _spawn_ask(self, key: str, answer: type[Record]) -> None:
        async def ask_soon() -> None:
            await asyncio.sleep(SETTLE)
            await self._ask(key, answer)

        self._tasks.spawn(ask_soon())

    async def _ask(self, key: str, answer: type[Record]) -> bool:
        """Query, and queue the answers. Returns whether there was one."""
        if not self._wants(key.partition("?")[0]):
            return False
        made, answered = codec(answer), False

        def take(key: str, record: Record) -> None:
            nonlocal answered
            heard = Heard(self._write_queue.now(), key, made.encode(record), made.encodings["json"], "query")
            self._write_queue.put(heard)
            answered = True

        async with self._room:
            try:
                errors = await self._bus.ask_all(key, answer, PATIENCE, take, limit=REPLIES)
                for error in errors.values():
                    log.debug("no_answer key=%s why=%s", key, error)
            except (BusClosed, BadRecord) as error:
                log.debug("not_asked key=%s why=%s", key, error)
        return answered

    def _wants(self, key: str) -> bool:
        return not self._only or any(one.intersects(zenoh.KeyExpr(key)) for one in self._only)
