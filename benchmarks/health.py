"""Collect the health records of a fleet's daemons during a benchmark, each with the time of its arrival.

Records are read as JSON and not by their declaration, so that those of an earlier revision can be read: a count is the
sum of all values of its name, wherever they are in the record.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import msgspec
import zenoh

from commd.bus.session import session_config
from schemas.wire import keys

LATE: Final = 1.5
"""Seconds between two records of a daemon after which the second one is late: one is due each second."""
DAEMONS: Final = ("commd", "bridged", "agentd")
Who = tuple[str, str]
"""A name and the kind of daemon that reports it."""


@dataclass
class HealthRecord:
    """A health record."""

    at: float
    """Monotonic seconds at which it came."""
    pid: int
    lag: float
    """Seconds by which the daemon's loop was late."""
    counts: Counter[str]


@dataclass
class Records:
    """Health records as they came: the time, the key and the bytes; they are read when all is over."""

    came: list[tuple[float, str, bytes]] = field(default_factory=list)

    def of_all(self) -> dict[Who, list[HealthRecord]]:
        """Return all records by sender, in the order in which they came."""
        found: dict[Who, list[HealthRecord]] = defaultdict(list)
        for at, key, payload in list(self.came):
            if (parsed := keys.parse(key)) is not None:
                raw = msgspec.json.decode(payload)
                counts: Counter[str] = Counter()
                _count(raw, counts)
                found[parsed[1], parsed[2][-1]].append(HealthRecord(at, raw.get("pid", 0), raw.get("lag", 0.0), counts))
        return found

    def last(self) -> dict[str, float]:
        """Return when the newest record of each key came."""
        return {key: at for at, key, _ in list(self.came)}

    def lag(self, begun: float, ended: float) -> dict[str, float]:
        """Return by how many seconds the loop of each kind of daemon was late at worst between two moments."""
        found: dict[str, float] = {}
        for (_, kind), those in self.of_all().items():
            within = (one.lag for one in those if begun <= one.at <= ended)
            found[kind] = max(found.get(kind, 0.0), max(within, default=0.0))
        return found


def _count(raw: Any, counts: Counter[str]) -> None:
    """Add the numbers of a record by their names; of digests of percept sets, `boot:seq:hash`, the second field."""
    for name, value in raw.items() if isinstance(raw, dict) else enumerate(raw) if isinstance(raw, list) else ():
        match value:
            case bool():
                pass
            case int() | float():
                counts[str(name)] += int(value)
            case str() if value.count(":") == 2:
                number = value.split(":")[1]
                counts["percepts"] += int(number) if number.isdecimal() else 0
            case _:
                _count(value, counts)


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
        records.came.append((time.monotonic(), str(sample.key_expr), sample.payload.to_bytes()))

    with zenoh.open(session_config("client", endpoint, "bench/health")) as session:
        session.declare_subscriber(keys.health(fleet, "*", "*"), zenoh.handlers.Callback(note, indirect=False))
        yield records


def grown(records: Records, begun: float, ended: float) -> defaultdict[str, Grown]:
    """Return what has grown from the last record before a time to the first behind it, by kinds of daemons.

    So what was lost at the edges of that time counts too; a daemon without records then counts with those it has.
    """
    total: defaultdict[str, Grown] = defaultdict(Grown)
    for (_, kind), those in records.of_all().items():
        first, last = _edges(those, begun, ended)
        numbers = Counter(last.counts)
        numbers.subtract(first.counts)
        total[kind].counts.update(numbers)
        if last.at > first.at:
            for name, count in numbers.items():
                total[kind].rates[name] += count / (last.at - first.at)
    return total


def _edges(those: list[HealthRecord], begun: float, ended: float) -> tuple[HealthRecord, HealthRecord]:
    first = next((one for one in reversed(those) if one.at <= begun), those[0])
    return first, next((one for one in those if one.at >= ended), those[-1])


def errors(records: Records, begun: float, ended: float) -> int:
    """Return how many lines all processes logged as errors in a time; one process has records under several names."""
    found: dict[int, int] = {}
    for those in records.of_all().values():
        first, last = _edges(those, begun, ended)
        before = first.counts["errors"] if first.pid == last.pid else 0
        found[last.pid] = max(found.get(last.pid, 0), last.counts["errors"] - before)
    return sum(found.values())


def late(records: Records, begun: float, ended: float) -> int:
    """Return how many records came later than `LATE` after the one before; a kind of daemon without records counts."""
    found = records.of_all()
    silent = sum(all(kind != daemon for _, kind in found) for daemon in DAEMONS)
    return silent + sum(gaps([one.at for one in those], begun, ended, LATE) for those in found.values())


def gaps(times: list[float], begun: float, ended: float, limit: float) -> int:
    """Return how many waits of more than `limit` s there were for what comes again and again, from `begun` to `ended`.

    What had begun before that time counts, and what lasted beyond it: nothing at all is a wait too.
    """
    within = [at for at in times if begun <= at <= ended]
    return sum(after - before > limit for before, after in pairwise([begun, *within, ended]))
