"""What the daemons of a fleet tell of themselves while a benchmark looks on: each record with the moment it came."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import zenoh

from commd.bus.session import session_config
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.health import each_health
from schemas.wire.records import Health

LATE: Final = 1.5
"""Seconds between two records of a daemon after which the second one is late: one is told each second."""
Who = tuple[str, str]
"""A name and the kind of daemon that tells of it."""


@dataclass
class Records:
    """Health records as they came: the time, the key and the bytes; they are read when all is over."""

    came: list[tuple[float, str, bytes, str]] = field(default_factory=list)

    def of_all(self) -> dict[Who, list[tuple[float, Health]]]:
        """Return all records by who told them, in the order in which they came."""
        found: dict[Who, list[tuple[float, Health]]] = defaultdict(list)
        for at, key, payload, encoding in self.came:
            if (parsed := keys.parse(key)) is not None:
                for name, health in each_health(parsed[1], codec(Health).decode(payload, encoding)):
                    found[name, parsed[2][-1]].append((at, health))
        return found


@dataclass
class Grown:
    """By how much the counters of all daemons of a kind have grown."""

    counts: Counter[str] = field(default_factory=Counter)
    rates: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    """A second."""


@contextmanager
def listening(endpoint: str, fleet: str) -> Iterator[Records]:
    """Listen to all daemons of a fleet while the block lasts."""
    records = Records()

    def note(sample: zenoh.Sample) -> None:
        records.came.append((time.monotonic(), str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)))

    with zenoh.open(session_config("client", endpoint, "bench/scale")) as session:
        session.declare_subscriber(keys.health(fleet, "*", "*"), zenoh.handlers.Callback(note, indirect=False))
        yield records


def grown(records: Records, begun: float, ended: float) -> defaultdict[str, Grown]:
    """Return what has grown from the last record before a time to the first behind it, by kinds of daemons.

    So what was lost at the edges of that time counts too; who told nothing then or never again counts with what is
    there.
    """
    total: defaultdict[str, Grown] = defaultdict(Grown)
    for (_, kind), told in records.of_all().items():
        (since, first), (until, last) = _edges(told, begun, ended)
        numbers = _numbers(last)
        numbers.subtract(_numbers(first))
        total[kind].counts.update(numbers)
        if until > since:
            for name, count in numbers.items():
                total[kind].rates[name] += count / (until - since)
    return total


def _edges(told: list[tuple[float, Health]], begun: float, ended: float) -> list[tuple[float, Health]]:
    first = next((one for one in reversed(told) if one[0] <= begun), told[0])
    return [first, next((one for one in told if one[0] >= ended), told[-1])]


def _numbers(told: Health) -> Counter[str]:
    found = Counter({name: int(count) for name, count in told.counters.items()})
    found["drops"], found["bad_input"] = told.drops, told.bad_input
    found["percepts"] = sum(int(digest.split(":")[1]) for digest in told.percepts.values() if digest.count(":") == 2)
    return found


def errors(records: Records, begun: float, ended: float) -> int:
    """Return how many lines all processes logged as errors in a time; each tells of itself under several names."""
    found: dict[int, int] = {}
    for told in records.of_all().values():
        (_, first), (_, last) = _edges(told, begun, ended)
        found[last.pid] = max(found.get(last.pid, 0), last.errors - (first.errors if first.pid == last.pid else 0))
    return sum(found.values())


def late(records: Records, begun: float, ended: float, wanted: Mapping[str, int]) -> int:
    """Return how many records came later than `LATE` after the one before, or not at all.

    `wanted` is how many of each kind of daemon there have to be: one that told nothing counts as one late record.
    """
    times: dict[Who, list[float]] = {who: [at for at, _ in told] for who, told in records.of_all().items()}
    silent = sum(max(0, count - sum(kind == one for _, one in times)) for kind, count in wanted.items())
    return silent + sum(gaps(those, begun, ended, LATE) for those in times.values())


def gaps(times: list[float], begun: float, ended: float, limit: float) -> int:
    """Return how many waits of more than `limit` s there were for what comes again and again, from `begun` to `ended`.

    What had begun before that time counts, and what lasted beyond it: nothing at all is a wait too.
    """
    within = [at for at in times if begun <= at <= ended]
    return sum(after - before > limit for before, after in pairwise([begun, *within, ended]))
