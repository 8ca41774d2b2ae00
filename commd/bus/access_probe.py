"""Find out whether the router lets this daemon through. Zenoh's router drops silently what its access rules deny: a put
returns, a declaration succeeds, a query has no reply. So a daemon looks from a second session, at the start and after
each change, whether others see what it declared, and whether its puts arrive.

The router's admin space has this too, and must not be asked: with Zenoh 1.10 a router that lists declarations while
somebody declares may hang for ever. A trial of a key is made one level below it, where the same access rules hold and
no daemon listens.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from commd.bus.errors import BusClosed
from commd.bus.raw import RawBus, Sample
from commd.common.tasks import wait_at_most
from schemas.wire.keys import ROOT

if TYPE_CHECKING:
    from commd.bus.bus import Bus
    from commd.bus.raw import Publisher, Querier

PATIENCE = 2.0
"""Wall seconds that a declaration has to appear, and a put to arrive."""
AGAIN = 0.05
"""Wall seconds between two attempts: a new declaration may not have reached the other session yet."""
ALL_FORBIDDEN = 1.0
"""Wall seconds that forbidden keys are tried for, where no allowed key shows when they had enough time."""
ANSWER = 1.0
"""Wall seconds that the router has to answer."""
SETTLING = 5.0
"""Wall seconds from a change to the check."""
LOOK_AGAIN = 30.0
"""Wall seconds to the next check after a denial or an unknown result: the router may only have been busy."""
KINDS = {"queryable": "to serve", "subscriber": "to subscribe to", "token": "to hold the token"}
ROUTER = "@/*/router"
"""Selector of a router's description of itself."""
log = logging.getLogger("access")


async def find_denials(bus: Bus, puts: Collection[str] = ()) -> str | None:
    """Return a text of what the router denies of all that was declared and of these keys to put on; empty if nothing.

    None: not known, because the router does not answer.
    """
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
    return await denial_text(bus, denied) if denied else ""


async def denial_text(bus: Bus, denied: Sequence[str]) -> str:
    """Return what is denied, by whom, and what to do."""
    many = f", and {len(denied) - 2} more" if len(denied) > 2 else ""
    text = f"{await router_name(bus)} denies {bus.daemon} of `{bus.name}`: {', '.join(denied[:2])}{many}"
    return f"{text}: by its rules they are not of its board; `argosy units` writes new rules from the mission file"


async def router_name(bus: Bus) -> str:
    """Return the name of this daemon's router."""
    for answer in await bus.raw.look_up(ROUTER, ANSWER):
        try:
            return f"the router `{json.loads(answer.payload)['metadata']['name']}`"
        except (ValueError, KeyError, TypeError):
            continue
    return "the router"


class Watch:
    """Checks after each change of the bus's declarations, and when the router is back, what the router denies."""

    def __init__(self, bus: Bus) -> None:
        self.note = ""
        """What is denied now, for people; empty if nothing."""
        self._bus = bus

    async def run(self) -> None:
        """Check after each change, and every `LOOK_AGAIN` seconds while something is denied or unknown, for ever."""
        settled = True
        while True:
            await wait_at_most(self._bus.declarations_changed, None if settled else LOOK_AGAIN)
            await asyncio.sleep(SETTLING)
            self._bus.declarations_changed.clear()
            settled = await self._look()

    async def _look(self) -> bool:
        """Check once. Returns whether nothing is denied or unknown."""
        if not self._bus.declared:
            self.note = ""
            return True
        try:
            note = await find_denials(self._bus)
        except Exception as error:  # the next check may do better; without one a denial would never be reported
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
    """Return the declarations of a session that another one does not see."""
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


async def which_come_through(
    speaker: RawBus, listener: RawBus, puts: Collection[str], patience: float, forbidden: Collection[str] = ()
) -> set[str]:
    """Put on each key until all arrive twice, or for `patience` wall seconds. Returns the keys that arrived.

    The `forbidden` ones should not: they were put at least as often as the others.
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
            for publisher in reversed(publishers):  # the forbidden ones first, so that they had as much time
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
    """Query each key, which `server` serves, until all were answered twice, or for `patience` wall seconds.

    Returns the keys that were answered. The `forbidden` ones were asked at least as often as the others.
    """
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
