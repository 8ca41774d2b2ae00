"""Whether the router lets this daemon through. Zenoh's router drops without a word what its access rules deny: a put
returns, a declaration succeeds, a query has no reply. So a daemon asks its router, at the start and after each change,
whether what it declared is known there, and tries whether what it puts comes through.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from commd.trying import which_come_through

if TYPE_CHECKING:
    from commd.bus import Bus

PATIENCE = 2.0
"""Wall seconds that a declaration has to be known to the router, and a put to come through."""
AGAIN = 0.05
ANSWER = 1.0
"""Wall seconds that the router has to answer."""
SETTLING = 5.0
"""Wall seconds after a change until it is looked whether it is known."""
KINDS = {"queryable": "to serve", "subscriber": "to subscribe to", "token": "to hold the token"}
log = logging.getLogger("access")

Declared = tuple[str, str]
"""A kind of Zenoh's, as its admin space calls it, and a key expression."""


async def refused(bus: Bus, puts: Collection[str] = ()) -> str:
    """Return in words what the router denies of all that was declared and of these keys to put on; empty if nothing.

    What cannot be known, because the router does not answer or does not tell, is no denial.
    """
    loop = asyncio.get_running_loop()
    until = loop.time() + PATIENCE
    missing = set(bus.declared)
    while missing and (known := await _known(bus)) is not None:
        missing = set(bus.declared) - known
        if not missing or loop.time() >= until:
            break
        await asyncio.sleep(AGAIN)
    else:
        missing = set()
    denied = [f"{KINDS[kind]} {key}" for kind, key in sorted(missing)]
    if puts and bus.guarded:
        denied += [f"to put on {key}" for key in await _silenced(bus, puts)]
    return await in_words(bus, denied) if denied else ""


async def in_words(bus: Bus, denied: Sequence[str]) -> str:
    """Say what is denied, by whom, and what to do."""
    many = f", and {len(denied) - 2} more" if len(denied) > 2 else ""
    text = f"{await router_name(bus)} denies {bus.daemon} of `{bus.name}`: {', '.join(denied[:2])}{many}"
    return f"{text}: by its rules they are not of its board; `argosy units` makes them anew from the mission file"


async def router_name(bus: Bus) -> str:
    """Return what this daemon's router is called."""
    for _, said in await _ask(bus, "@/*/router"):
        name = (said.get("metadata") or {}).get("name")
        if name:
            return f"the router `{name}`"
    return "the router"


class Watch:
    """Looks a moment after each declaration whether it is known to the router, and keeps what is denied in words."""

    def __init__(self, bus: Bus) -> None:
        self.note = ""
        """What is denied now; empty if nothing."""
        self._bus, self._due = bus, asyncio.Event()

    def changed(self) -> None:
        """Something was declared or taken back."""
        self._due.set()

    async def run(self) -> None:
        """Look whenever something changed, for ever."""
        while True:
            await self._due.wait()
            await asyncio.sleep(SETTLING)
            self._due.clear()
            note = await refused(self._bus)
            if note and note != self.note:
                log.error("denied %s", note)
            self.note = note


async def _known(bus: Bus) -> set[Declared] | None:
    """What the router knows of this session's declarations; None if it does not say."""
    if not await _ask(bus, "@/*/router"):
        return None
    known: set[Declared] = set()
    for kind in sorted({kind for kind, _ in bus.declared}):
        mark = f"/router/{kind}/"
        for key, said in await _ask(bus, f"@/*{mark}**"):
            if bus.zid in said.get("clients", ()):
                known.add((kind, key.partition(mark)[2]))
    return known


async def _ask(bus: Bus, key: str) -> list[tuple[str, dict[str, Any]]]:
    """Ask the router's admin space."""
    found = []
    for sample in await bus.raw.look_up(key, ANSWER):
        try:
            said = json.loads(sample.payload)
        except ValueError:
            continue
        if isinstance(said, dict):
            found.append((sample.key, said))
    return found


async def _silenced(bus: Bus, puts: Iterable[str]) -> list[str]:
    """Return those of the keys on which a put of this session does not come through."""
    from commd.bus import BusClosed, open_bus

    try:
        async with open_bus(
            bus.endpoint, fleet=bus.fleet, name=bus.name, daemon="access", stamp=lambda: 0, tls=bus.tls, patience=ANSWER
        ) as listener:
            puts = list(puts)
            through = await which_come_through(bus.raw, listener.raw, puts, PATIENCE)
    except BusClosed:
        return []
    return [key for key in puts if key not in through]
