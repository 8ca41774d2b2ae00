"""What is said on the bus, as bytes, for tools that show it: of one router, or of all boards of a fleet with keys."""

from __future__ import annotations

import asyncio
import re
import sys
import time
from argparse import ArgumentParser, ArgumentTypeError
from collections import deque
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock

import zenoh

from argosy.fleet_bus import FleetBus
from argosy.operator_bus import ANY, Where
from commd.bus import Bus
from schemas import keys

ROOM = 10_000
"""Samples that wait to be shown; of more the newest are dropped, and counted."""
REMEMBERED = 2_000
"""Samples by which is known what another board has told already."""
TURN = 64
"""Samples that are shown in one go before the event loop turns to others, such as ctrl-C."""
QUIET = 3.0
"""Wall seconds without a word after which it is said who is there."""
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_.-]*")


@dataclass(frozen=True, slots=True)
class Heard:
    """Something that was put."""

    key: str
    payload: bytes
    encoding: str
    at: float
    """Unix seconds of its arrival."""
    arrived: float
    """The same by the clock of the event loop, which nobody sets."""
    deleted: bool = False


def add_key_argument(parser: ArgumentParser) -> None:
    """Declare what is listened to."""
    what = "a key expression such as 'argosy/*/*/status/**' or 'uav/percept/*', or the name of an agent, robot or board"
    parser.add_argument(
        "key", nargs="?", type=_key, metavar="KEY", help=f"{what} (default: everything but the course of minds)"
    )


def _key(text: str) -> str:
    try:
        zenoh.KeyExpr(text)
    except zenoh.ZError:
        raise ArgumentTypeError(f"expected a key expression such as `uav/percept/*`, got `{text}`") from None
    return text


def key_expressions(text: str | None, fleet: str) -> list[str]:
    """Return what to listen to for what a user names."""
    within = f"{keys.ROOT}/{fleet}"
    if text is None or _NAME.fullmatch(text):
        return what_is_told(fleet, text or "*")
    if text == "**":
        return [f"{within}/**"]
    if text == keys.ROOT or text.startswith((f"{keys.ROOT}/", "@")):
        return [text]
    return [f"{within}/{text}", text] if "/" in text else [f"{within}/{text}"]  # robots on Zenoh have keys of their own


def what_is_told(fleet: str, name: str = "*") -> list[str]:
    """Return the keys on which something is put under a name, but for the course of minds, told only to who listens."""
    rests = [channel.key.split("/")[1:] for channel in keys.CHANNELS if channel.kind == "put"]
    kinds = {rest[0]: "/**" if len(rest) > 1 else "" for rest in rests if rest[0] != "trace"}
    return [f"{keys.ROOT}/{fleet}/{name}/{kind}{further}" for kind, further in kinds.items()]


class Ears:
    """Hears what is put on some keys, in the order in which it comes."""

    def __init__(self, bus: Bus, expressions: Sequence[str]) -> None:
        self.dropped = 0
        """Samples that did not fit: more was said than could be shown."""
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Heard] = deque()
        self._lock, self._called = Lock(), asyncio.Event()
        self._known: dict[tuple[str, int], None] | None = {} if isinstance(bus, FleetBus) else None
        """With several boards: what one of them has told."""
        self._expressions, self._held = expressions, list[object]()
        if isinstance(bus, FleetBus):
            bus.boards.at_each(lambda _, its: self._listen(its))
        else:
            self._listen(bus)

    async def samples(self, until: float | None = None) -> AsyncIterator[Heard]:
        """Yield what is heard, for ever or until a time of the event loop."""
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
                if self._is_new(heard):
                    yield heard
                continue
            try:
                async with asyncio.timeout_at(until):
                    await self._called.wait()
            except TimeoutError:
                return

    def _listen(self, bus: Bus) -> None:
        for expression in self._expressions:
            self._held.append(bus.raw.tap(expression, self._take))

    def _take(self, sample: zenoh.Sample) -> None:
        """On a thread of Zenoh's."""
        deleted = sample.kind == zenoh.SampleKind.DELETE
        key, payload, encoding = str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)
        heard = Heard(key, payload, encoding, time.time(), time.monotonic(), deleted)
        with self._lock:
            if len(self._waiting) >= ROOM:
                self.dropped += 1
                return
            self._waiting.append(heard)
            first = len(self._waiting) == 1
        if first:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._called.set)

    def _is_new(self, heard: Heard) -> bool:
        if self._known is None:
            return True
        what = heard.key, hash(heard.payload)
        if what in self._known:
            return False
        self._known[what] = None
        while len(self._known) > REMEMBERED:
            del self._known[next(iter(self._known))]
        return True


async def names_there(bus: Bus, fleet: str) -> dict[tuple[str, str], set[str]]:
    """Return who holds a name: fleet and name to the daemons."""
    found: dict[tuple[str, str], set[str]] = {}
    for token in await bus.tokens(keys.alive(fleet, "*", "*", "*")):
        if (parsed := keys.parse(token)) is not None and len(parsed[2]) == 3:
            found.setdefault((parsed[0], parsed[1]), set()).add(parsed[2][1])
    return found


async def tell_who_is_there(bus: Bus, where: Where, text: str | None) -> None:
    """Say on stderr that nothing is heard of what a user named, and who could say something."""
    there = await names_there(bus, where.fleet)
    of = "" if text is None else f" by or to `{text}`" if _NAME.fullmatch(text) else f" on {text}"
    quiet = f"nothing was said{of} within {QUIET:g} s"
    if not there:
        of = f"fleet `{where.fleet}`" if where.fleet != ANY else "any fleet"
        who = f"nobody of {of} is on the bus at {where.router}"
    else:
        fleets: dict[str, list[str]] = {}
        for fleet, name in sorted(there):
            fleets.setdefault(fleet, []).append(name)
        who = "; ".join(f"fleet {fleet} has {', '.join(names)}" for fleet, names in fleets.items())
    print(f"note: {quiet}; {who}", file=sys.stderr, flush=True)
