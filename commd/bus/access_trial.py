"""Trying what a router lets through, between two sessions: nobody but the one that listens hears of it.

A trial of a key is made one level below it, where access rules hold as on the key itself and no daemon listens.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Collection

from commd.bus.raw import RawBus, Sample
from commd.common.tasks import wait_at_most

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
