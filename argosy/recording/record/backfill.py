"""What a recorder asks a fleet for: what was there before it came, and what it has missed since.

Percepts, manifests, directories and mailboxes are told when they change, and the inputs of a mind only while somebody
listens: who comes late asks for what there is.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable
from functools import partial

import msgspec
import zenoh

from argosy.recording.file.mind_inputs import in_words, stretches
from argosy.recording.file.records import PREFIX, TokenSeen
from argosy.recording.file.write_queue import Heard, WriteQueue
from argosy.recording.record.minds import Minds, Whose
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from commd.common.tasks import Tasks
from schemas.wire import keys
from schemas.wire.codec import BadRecord, codec
from schemas.wire.mind_records import MindInputs, MindView
from schemas.wire.records import BoardServices, LiveManifest, Mailboxes, Perception, Record

PATIENCE = 5.0
"""Wall seconds that a fleet has to answer."""
SETTLE = 0.3
"""Wall seconds between a token and a question: a daemon shows itself before it serves."""
AGAIN = (0.3, 1.0, 3.0)
"""Wall seconds after which an agent is asked for its inputs, again if it did not answer."""
LOOK = 1.0
"""Wall seconds between two looks at what is missing."""
TRIES = 3
"""How often a life is asked for the same that is missing."""
AT_ONCE = 8
"""Questions under way."""
REPLIES = 100_000
"""Replies to one question that may wait."""
log = logging.getLogger("recorder")


class Backfill:
    """Follows the tokens of a fleet and asks each daemon that comes."""

    def __init__(self, bus: Bus, fleet: str, write_queue: WriteQueue, minds: Minds, only: Iterable[str] = ()) -> None:
        """`fleet` may be `*`. With `only`, key expressions, nothing else is asked for."""
        self.tokens = 0
        """Daemons that are there now."""
        self._bus, self._fleet, self._write_queue, self._minds = bus, fleet, write_queue, minds
        self._only = [zenoh.KeyExpr(key) for key in only]
        self._tasks = Tasks("asking for what was before")
        self._room = asyncio.Semaphore(AT_ONCE)
        self._tried: dict[Whose, tuple[frozenset[int], int]] = {}
        self._perceiving: set[str] = set()
        """Fleets whose percepts are about to be asked for."""

    def start(self) -> None:
        """Begin to follow the fleet."""
        self._bus.watch(keys.alive(self._fleet, "*", "*", "*"), self._token)
        self._tasks.spawn(self._repair())

    async def close(self) -> None:
        """Ask no longer."""
        await self._tasks.end()

    async def last_look(self) -> None:
        """Ask once more for what is missing, before the end."""
        for whose in self._minds.missing():
            if self._tried.get(whose, (frozenset(), 0))[1] < TRIES:
                await self._inputs(whose.fleet, whose.agent)

    def look_again(self) -> None:
        """Ask for all that may have changed while the router was away."""
        self._perceive(self._fleet)
        self._tried.clear()

    def _token(self, key: str, alive: bool) -> None:
        self.tokens += 1 if alive else -1
        parsed = keys.parse(key)
        if parsed is None or len(parsed[2]) != 3:
            return
        fleet, name, (_, daemon, _) = parsed
        payload = msgspec.json.encode(TokenSeen(key=key, alive=alive))
        topic = f"{keys.ROOT}/{fleet}/{name}/alive/{daemon}"
        encoding = f"application/json;{PREFIX}{TokenSeen.__name__}/1"
        if self._wants(keys.alive(fleet, name, daemon, "*")):
            self._write_queue.put(Heard(self._write_queue.now(), topic, payload, encoding, "token"))
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
        """Ask for all percepts of a fleet, soon; several bridges that come together are asked once."""
        if fleet not in self._perceiving:
            self._perceiving.add(fleet)
            self._tasks.spawn(self._percepts(fleet))

    async def _percepts(self, fleet: str) -> None:
        await asyncio.sleep(LOOK)
        self._perceiving.discard(fleet)
        await self._ask(f"{keys.ROOT}/{fleet}/*/percept/**", Perception)

    async def _mind(self, fleet: str, agent: str) -> None:
        if self._wants(keys.mind(fleet, agent)):
            self._tasks.spawn(
                self._later(SETTLE, partial(self._ask, f"{keys.mind(fleet, agent)}?plans=true", MindView))
            )
        if not self._wants(keys.trace(fleet, agent, "inputs")):
            return
        for seconds in AGAIN:
            await asyncio.sleep(seconds)
            if await self._inputs(fleet, agent):
                return

    async def _inputs(self, fleet: str, agent: str) -> bool:
        return await self._ask(keys.trace(fleet, agent, "inputs"), MindInputs)

    async def _repair(self) -> None:
        """Ask for stretches that are missing, a few times each."""
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
                    log.warning("%s: its inputs %s are missing for good", whose.agent, in_words(stretches(left)))

    def _spawn_ask(self, key: str, answer: type[Record]) -> None:
        self._tasks.spawn(self._later(SETTLE, partial(self._ask, key, answer)))

    async def _later(self, seconds: float, do: Callable[[], Awaitable[object]]) -> None:
        await asyncio.sleep(seconds)
        await do()

    async def _ask(self, key: str, answer: type[Record]) -> bool:
        """Ask, and take in what is answered. Returns whether anybody answered."""
        if not self._wants(key.partition("?")[0]):
            return False
        made, answered = codec(answer), False

        def told(key: str, record: Record) -> None:
            nonlocal answered
            heard = Heard(self._write_queue.now(), key, made.encode(record), made.encoding("json"), "query")
            self._write_queue.put(heard)
            answered = True

        async with self._room:
            try:
                errors = await self._bus.ask_all(key, answer, PATIENCE, told, limit=REPLIES)
                for error in errors.values():
                    log.debug("no_answer key=%s why=%s", key, error)
            except (BusClosed, BadRecord) as error:
                log.debug("not_asked key=%s why=%s", key, error)
        return answered

    def _wants(self, key: str) -> bool:
        return not self._only or any(one.intersects(zenoh.KeyExpr(key)) for one in self._only)
