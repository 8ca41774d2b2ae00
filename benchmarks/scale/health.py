"""What the daemons of a fleet tell of themselves while a benchmark looks on: each record with the moment it came."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

import zenoh

from commd.session import session_config
from schemas import keys
from schemas.codec import codec
from schemas.records import Health

LATE: Final = 1.5
"""Seconds between two records of a daemon after which the second one is late: one is told each second."""


@dataclass
class Records:
    """Health records as they came: the time, the key and the bytes; they are read when all is over."""

    came: list[tuple[float, str, bytes, str]] = field(default_factory=list)

    def between(self, begun: float, ended: float) -> dict[tuple[str, str], list[tuple[float, Health]]]:
        """Return the records of a time, by name and daemon."""
        found: dict[tuple[str, str], list[tuple[float, Health]]] = defaultdict(list)
        for at, key, payload, encoding in self.came:
            if begun <= at <= ended and (parsed := keys.parse(key)) is not None:
                found[parsed[1], parsed[2][-1]].append((at, codec(Health).decode(payload, encoding)))
        return found


@contextmanager
def listening(endpoint: str, fleet: str) -> Iterator[Records]:
    """Listen to all daemons of a fleet while the block lasts."""
    records = Records()

    def note(sample: zenoh.Sample) -> None:
        records.came.append((time.monotonic(), str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding)))

    with zenoh.open(session_config("client", endpoint, "bench/scale")) as session:
        session.declare_subscriber(keys.health(fleet, "*", "*"), zenoh.handlers.Callback(note, indirect=False))
        yield records


def grown(records: dict[tuple[str, str], list[tuple[float, Health]]], daemon: str) -> Counter[str]:
    """Return by how much the counters of all daemons of a kind have grown from their first record to their last."""
    total: Counter[str] = Counter()
    for (_, kind), told in records.items():
        if kind != daemon:
            continue
        first, last = told[0][1], told[-1][1]
        total["drops"] += last.drops - first.drops
        total["bad_input"] += last.bad_input - first.bad_input
        total["errors"] += last.errors - first.errors
        for name, count in last.counters.items():
            total[name] += int(count - first.counters.get(name, 0))
    return total


def late(records: dict[tuple[str, str], list[tuple[float, Health]]]) -> int:
    """Return how many records came later than `LATE` after the one before."""
    pairs = (pair for told in records.values() for pair in pairwise(told))
    return sum(after[0] - before[0] > LATE for before, after in pairs)


def worst_lag(records: dict[tuple[str, str], list[tuple[float, Health]]], daemon: str) -> float:
    """Return the seconds by which a daemon of a kind was behind at worst."""
    return max((one.lag for (_, kind), told in records.items() if kind == daemon for _, one in told), default=0.0)
