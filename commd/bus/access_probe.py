"""Whether the router lets this daemon through. Zenoh's router drops without a word what its access rules deny: a put
returns, a declaration succeeds, a query has no reply. So a daemon looks from a second session, at the start and after
each change, whether what it declared can be seen by others, and whether what it puts comes through.

The router's admin space would tell too, and must not be asked: with Zenoh 1.10 a router that lists what is declared
while somebody declares may stand still for ever.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from commd.bus.errors import BusClosed
from commd.common.tasks import wait_at_most
from schemas.wire.keys import ROOT

if TYPE_CHECKING:
    from commd.bus.bus import Bus
    from commd.bus.raw import Publisher, Querier
import os

from commd.bus.raw import RawBus, Sample

PATIENCE = 2.0
"""Wall seconds that a declaration has to be seen, and a put to come through."""
AGAIN = 0.05
ANSWER = 1.0
"""Wall seconds that the router has to answer."""
SETTLING = 5.0
"""Wall seconds after a change until it is looked whether it is seen."""
LOOK_AGAIN = 30.0
"""Wall seconds until it is looked again, unless all is well: the router may only have been busy."""
KINDS = {"queryable": "to serve", "subscriber": "to subscribe to", "token": "to hold the token"}
ROUTER = "@/*/router"
"""What a router says of itself."""
log = logging.getLogger("access")


async def refused(bus: Bus, puts: Collection[str] = ()) -> str:
    """Return in words what the router denies of all that was declared and of these keys to put on; empty if nothing.

    What cannot be known, because the router does not answer, is no denial.
    """
    return await known_refused(bus, puts) or ""


async def known_refused(bus: Bus, puts: Collection[str] = ()) -> str | None:
    """Return what `refused` does, or None if it cannot be known."""
    try:
        async with bus.second_session(ANSWER) as other:
            unseen = await _unseen(bus, other)
            through = await which_come_through(bus.raw, other.raw, puts, PATIENCE) if puts else set()
            answers = await other.raw.look_up(ROUTER, ANSWER)
    except BusClosed:
        return None
    denied = [f"{KINDS[kind]} {key}" for kind, key in unseen]
    denied += [f"to put on {key}" for key in puts if key not in through]
    if denied and not answers:
        return None
    return await in_words(bus, denied) if denied else ""


async def in_words(bus: Bus, denied: Sequence[str]) -> str:
    """Say what is denied, by whom, and what to do."""
    many = f", and {len(denied) - 2} more" if len(denied) > 2 else ""
    text = f"{await router_name(bus)} denies {bus.daemon} of `{bus.name}`: {', '.join(denied[:2])}{many}"
    return f"{text}: by its rules they are not of its board; `argosy units` makes them anew from the mission file"


async def router_name(bus: Bus) -> str:
    """Return what this daemon's router is called."""
    for answer in await bus.raw.look_up(ROUTER, ANSWER):
        try:
            return f"the router `{json.loads(answer.payload)['metadata']['name']}`"
        except (ValueError, KeyError, TypeError):
            continue
    return "the router"


class Watch:
    """Looks a moment after each declaration, and each time that the router came, whether it is known to it, and keeps
    what is denied in words."""

    def __init__(self, bus: Bus) -> None:
        self.note = ""
        """What is denied now; empty if nothing."""
        self._bus, self._due = bus, asyncio.Event()

    def changed(self) -> None:
        """Something was declared or taken back, or the router came."""
        self._due.set()

    async def run(self) -> None:
        """Look whenever something changed, and now and then while something is denied or not known, for ever."""
        settled = True
        while True:
            await wait_at_most(self._due, None if settled else LOOK_AGAIN)
            await asyncio.sleep(SETTLING)
            self._due.clear()
            settled = await self._look()

    async def _look(self) -> bool:
        """Look once. Returns whether all is known and well."""
        if not self._bus.declared:
            self.note = ""
            return True
        try:
            note = await known_refused(self._bus)
        except Exception as error:  # the next look may do better; without one, what is denied would never be told
            log.exception("defect in argosy: %s: %s", type(error).__name__, error)
            return False
        if note is None:
            return False
        if note and note != self.note:
            log.error("denied %s", note)
        elif self.note and not note:
            log.info("allowed again")
        self.note = note
        return not note


async def _unseen(bus: Bus, other: Bus) -> list[tuple[str, str]]:
    """Return what a session has declared and another one does not see."""
    declared = sorted(bus.declared)
    seekers: dict[tuple[str, str], Querier | Publisher] = {}
    for kind, key in declared:
        if kind == "queryable":
            seekers[kind, key] = other.raw.querier(key)
        elif kind == "subscriber":
            seekers[kind, key] = other.raw.publisher(key)
    tokens = [key for kind, key in declared if kind == "token"]
    loop = asyncio.get_running_loop()
    until = loop.time() + PATIENCE
    try:
        while True:
            held = set(await other.tokens(f"{ROOT}/{bus.fleet}/*/alive/**")) if tokens else set[str]()
            unseen = [("token", key) for key in tokens if key not in held]
            unseen += [one for one, seeker in seekers.items() if not seeker.matching]
            unseen = sorted(one for one in unseen if one in bus.declared)
            if not unseen or loop.time() >= until:
                return unseen
            await asyncio.sleep(AGAIN)
    finally:
        for seeker in seekers.values():
            seeker.close()


AGAIN = 0.05
"""Wall seconds between two attempts: what was just declared may not have reached the other one yet."""
ALL_FORBIDDEN = 1.0
"""Wall seconds that what is forbidden has where nothing is allowed that would show that it had its time."""


async def which_come_through(
    speaker: RawBus, listener: RawBus, puts: Collection[str], patience: float, forbidden: Collection[str] = ()
) -> set[str]:
    """Put on each key until all come through, or for `patience` wall seconds. Returns those that did.

    Those that are `forbidden` should not: they have come twice if the others have.
    """
    probes = {f"{key}/{_nonce()}": key for key in (*puts, *forbidden)}
    heard: dict[str, int] = dict.fromkeys(probes, 0)
    news = asyncio.Event()

    def hear(sample: Sample) -> None:
        if sample.key in heard:
            heard[sample.key] += 1
            news.set()

    subscriptions = [listener.subscribe(probe, hear) for probe in probes]
    publishers = [speaker.publisher(probe) for probe in probes]
    loop = asyncio.get_running_loop()
    wanted = [probe for probe, key in probes.items() if key not in forbidden]
    until = loop.time() + (patience if wanted else min(patience, ALL_FORBIDDEN))
    try:
        while loop.time() < until and not (wanted and min(heard[probe] for probe in wanted) >= 2):
            for publisher in reversed(publishers):  # the forbidden ones first: they have had their time by then
                publisher.put(b"", "zenoh/bytes")
            news.clear()
            await wait_at_most(news, AGAIN)
    finally:
        for declared in (*subscriptions, *publishers):
            declared.close()
    return {key for probe, key in probes.items() if heard[probe]}


async def which_are_answered(
    asker: RawBus, server: RawBus, asks: Collection[str], patience: float, forbidden: Collection[str] = ()
) -> set[str]:
    """Ask on each key, which `server` serves, until all are answered or for `patience` wall seconds. Returns those that
    were; those that are `forbidden` have been asked twice when the others are answered."""
    probes = {f"{key}/{_nonce()}": key for key in (*asks, *forbidden)}
    answered: dict[str, int] = dict.fromkeys(probes, 0)
    serving = [server.serve(probe, lambda asked: Sample(asked.key, b"", "zenoh/bytes")) for probe in probes]
    loop = asyncio.get_running_loop()
    wanted = [probe for probe, key in probes.items() if key not in forbidden]
    until = loop.time() + (patience if wanted else min(patience, ALL_FORBIDDEN))
    try:
        while loop.time() < until and not (wanted and min(answered[probe] for probe in wanted) >= 2):
            for probe in reversed(probes):
                answered[probe] += bool(await asker.look_up(probe, max(AGAIN, until - loop.time())))
            await asyncio.sleep(AGAIN)
    finally:
        for declared in serving:
            declared.close()
    return {key for probe, key in probes.items() if answered[probe]}


def _nonce() -> str:
    return f"trial-{os.urandom(6).hex()}"
