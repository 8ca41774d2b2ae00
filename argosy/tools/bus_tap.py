"""Samples on the bus as bytes, from one router or from all boards of a secured fleet."""

from __future__ import annotations

import asyncio
import hashlib
import re
import time
from argparse import ArgumentParser, ArgumentTypeError
from collections import deque
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from threading import Lock

import zenoh

from argosy.cli.fleet_bus import FleetBus
from argosy.cli.operator_bus import Where, names_there, note
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import Perception

ROOM = 10_000
"""Queued samples; further ones are dropped and counted."""
REMEMBERED = 10_000
"""Samples remembered to recognize copies from other boards."""
ANSWER_TIMEOUT = 5.0
"""Wall seconds for bridges to answer with their present percepts."""
LATER = 2.0
"""Wall seconds within which an equal sample from another board is a copy."""
TURN = 64
"""Samples shown before the event loop turns to other tasks, such as ctrl-C."""
QUIET = 3.0
"""Wall seconds of silence before a note with the running daemons."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*")


@dataclass(frozen=True, slots=True)
class Heard:
    """A sample that was put."""

    key: str
    payload: bytes
    encoding: str
    at: float
    """Arrival in Unix seconds."""
    arrived: float
    """Arrival by the monotonic clock of the event loop."""
    deleted: bool = False
    board: str = ""
    """The board whose router delivered it; empty = there is one router."""
    last_known: bool = False
    """Whether it is the answer to a query for the present value."""


def add_key_argument(parser: ArgumentParser) -> None:
    """Declare the key to listen to."""
    what = "a key expression such as 'argosy/*/*/status/**' or 'uav/percept/*', or the name of an agent, robot or board"
    parser.add_argument(
        "key", nargs="?", type=_key, metavar="KEY", help=f"{what} (default: everything except traces of minds)"
    )


def _key(text: str) -> str:
    try:
        zenoh.KeyExpr(text)
    except zenoh.ZError:
        raise ArgumentTypeError(f"expected a key expression such as `uav/percept/*`, got `{text}`") from None
    return text


def key_expressions(text: str | None, fleet: str) -> list[str]:
    """Return the key expressions of a KEY argument."""
    within = f"{keys.ROOT}/{fleet}"
    if text is None or _NAME.fullmatch(text):
        return published_keys(fleet, text or "*")
    if text == "**":
        return [f"{within}/**"]
    if text == keys.ROOT or text.startswith((f"{keys.ROOT}/", "@")):
        return [text]
    return [f"{within}/{text}", text] if "/" in text else [f"{within}/{text}"]  # robots on Zenoh have keys of their own


def published_keys(fleet: str, name: str = "*") -> list[str]:
    """Return the keys that are put under a name and that observers may see, except traces of minds.

    Percepts are those by their names, which bridges put while anybody subscribes to them.
    """
    rests = [channel.key.split("/")[1:] for channel in keys.CHANNELS if channel.kind == "put" and channel.sight]
    kinds = {rest[0]: "/**" if len(rest) > 1 else "" for rest in rests if rest[0] not in ("trace", "percepts")}
    return [f"{keys.ROOT}/{fleet}/{name}/{kind}{further}" for kind, further in kinds.items()]


class BusTap:
    """Receives what is put on some keys, in order of arrival."""

    def __init__(self, bus: Bus, expressions: Sequence[str]) -> None:
        self.dropped = 0
        """Samples that did not fit in the queue."""
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Heard] = deque()
        self._lock, self._called = Lock(), asyncio.Event()
        self._copies = Copies()
        self._expressions, self._held = expressions, list[object]()
        if isinstance(bus, FleetBus):
            bus.boards.at_each(self._listen)
        else:
            self._listen("", bus)

    async def samples(self, until: float | None = None) -> AsyncIterator[Heard]:
        """Yield samples, for ever or `until` a time of the event loop's clock, in seconds."""
        taken = 0
        while until is None or self._loop.time() < until:
            with self._lock:
                heard = self._waiting.popleft() if self._waiting else None
                if heard is None:
                    self._called.clear()
            if heard is not None:
                taken += 1
                if taken % TURN == 0:
                    await asyncio.sleep(0)
                if not heard.board or self._copies.is_new(heard):
                    yield heard
                continue
            try:
                async with asyncio.timeout_at(until):
                    await self._called.wait()
            except TimeoutError:
                return

    def _listen(self, board: str, bus: Bus) -> None:
        for place, expression in enumerate(self._expressions):
            overlapping = [one for one in map(zenoh.KeyExpr, self._expressions[:place]) if one.intersects(expression)]
            self._held.append(bus.raw.tap(expression, partial(self._take, board, overlapping)))

    def _take(self, board: str, overlapping: Sequence[zenoh.KeyExpr], sample: zenoh.Sample) -> None:
        """Queue a sample, unless an overlapping subscription does. Runs on a thread of Zenoh's."""
        if any(expression.intersects(sample.key_expr) for expression in overlapping):
            return
        deleted = sample.kind == zenoh.SampleKind.DELETE
        key, payload, encoding = str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)
        heard = Heard(key, payload, encoding, time.time(), time.monotonic(), deleted, board)
        self._queue(heard)

    def _queue(self, heard: Heard) -> None:
        with self._lock:
            if len(self._waiting) >= ROOM:
                self.dropped += 1
                return
            self._waiting.append(heard)
            first = len(self._waiting) == 1
        if first:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._called.set)

    async def ask_last_known(self, bus: Bus, fleet: str) -> None:
        """Query the present percepts on these keys: bridges put a percept only when it changes."""
        every, encoder = zenoh.KeyExpr(keys.percept(fleet, "*", "**")), codec(Perception)
        wanted = [one for one in map(zenoh.KeyExpr, self._expressions) if one.intersects(every)]
        asked = {str(one if every.includes(one) else every) for one in wanted}
        by_several_boards: set[tuple[str, bytes]] = set()

        def take(key: str, perception: Perception) -> None:
            if not any(one.intersects(key) for one in wanted):
                return
            payload = encoder.encode(perception, bus.wire)
            if (key, payload) not in by_several_boards:
                by_several_boards.add((key, payload))
                encoding = encoder.encodings[bus.wire]
                self._queue(Heard(key, payload, encoding, time.time(), time.monotonic(), last_known=True))

        for key in asked if str(every) not in asked else {str(every)}:
            with suppress(BusClosed):
                await bus.ask_all(key, Perception, ANSWER_TIMEOUT, take, limit=ROOM)


class Copies:
    """Distinguishes copies of a record, delivered by several boards, from a record that is put again."""

    def __init__(self) -> None:
        self._puts: dict[tuple[str, bool, bytes], deque[set[str]]] = {}
        """For each recent payload on a key, the boards that delivered it, for each time it was put."""
        self._order: deque[tuple[float, tuple[str, bool, bytes]]] = deque()

    def is_new(self, heard: Heard) -> bool:
        """Whether no other board has delivered this sample: each board delivers a record once."""
        while self._order and (len(self._order) >= REMEMBERED or self._order[0][0] < heard.arrived - LATER):
            _, old = self._order.popleft()
            self._puts[old].popleft()
            if not self._puts[old]:
                del self._puts[old]
        what = heard.key, heard.deleted, hashlib.blake2b(heard.payload, digest_size=16).digest()
        puts = self._puts.setdefault(what, deque())
        for boards in puts:
            if heard.board not in boards:
                boards.add(heard.board)
                return False
        puts.append({heard.board})
        self._order.append((heard.arrived, what))
        return True


async def note_who_is_there(bus: Bus, where: Where, text: str | None, seconds: float = QUIET) -> None:
    """Print on stderr that nothing was received for `seconds`, and which names are on the bus."""
    there = await names_there(bus, where.fleet)
    of = "" if text is None else f" by or to `{text}`" if _NAME.fullmatch(text) else f" on {text}"
    quiet = f"nothing was published{of} within {seconds:g} s"
    if not there:
        who = f"no daemon of {where.whose} is on the bus at {where.router}"
    else:
        fleets: dict[str, list[str]] = {}
        for fleet, name in sorted(there):
            fleets.setdefault(fleet, []).append(name)
        who = "; ".join(f"fleet {fleet} has {', '.join(names)}" for fleet, names in fleets.items())
    note(f"{quiet}; {who}")
