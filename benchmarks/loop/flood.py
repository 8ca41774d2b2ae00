"""Percepts at a steady rate through bridge and agent: whether each change makes its belief event, in order.

The program judges it: each `+tick(N, Of)` must be the one after the last, and it prints what came instead, or that all
`Of` have come in order.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import zenoh

from benchmarks.loop.board import Board, board
from schemas import keys
from schemas.codec import BadRecord, codec
from schemas.records import Health

SECONDS: Final = 4.0
"""For which a rate is kept up."""
KEEPS_UP: Final = 1.0
"""Seconds after the last change within which the last event has to be there."""
PATIENCE: Final = 8.0
"""Seconds after which events do not come any more."""
_LOST: Final = ("drops", "bad_input", "percepts_missed", "samples_dropped", "percepts_unreadable", "percepts_stale")
"""Figures of the daemons' health that must stay 0. What a set of percepts drops for lack of room stands in `drops`."""


@dataclass
class Flood:
    """One run."""

    rate: float
    """Changes a second that were wanted."""
    reached: float
    """That were made."""
    changes: int
    heard: int
    """Belief events that came, as the program has counted them."""
    behind: float
    """Seconds from the last change to the line that the program prints for the last event; -1: it never came."""
    lost: dict[str, float] = field(default_factory=dict)
    """Of the daemons' counters of what is lost those that are not 0."""
    disorder: list[str] = field(default_factory=list)
    """What the program said came instead of what; the first lines."""
    cpu: dict[str, float] = field(default_factory=dict)
    """Per cent of a core, of each daemon."""

    @property
    def complete(self) -> bool:
        """Whether each change made its event, in order, and nothing is counted as lost."""
        return self.heard == self.changes and not self.lost and not self.disorder

    @property
    def kept_up(self) -> bool:
        """Whether the agent was not left behind either."""
        return self.complete and 0 <= self.behind <= KEEPS_UP


class _Counters:
    """The newest figures of the daemons that count what is lost."""

    def __init__(self, session: zenoh.Session) -> None:
        self._of: dict[str, dict[str, float]] = {}
        key = keys.health("*", "*", "*")
        self._subscriber = session.declare_subscriber(key, self._heard)

    def _heard(self, sample: zenoh.Sample) -> None:
        try:
            health = codec(Health).decode(sample.payload.to_bytes(), str(sample.encoding))
        except BadRecord:
            return
        figures = {"drops": health.drops, "bad_input": health.bad_input, **health.counters}
        self._of[f"{health.daemon} {health.header.source}"] = {name: figures.get(name, 0) for name in _LOST}

    def now(self) -> dict[str, float]:
        """Return the figures, by daemon and name."""
        return {f"{who}: {name}": value for who, of in self._of.items() for name, value in of.items()}

    def close(self) -> None:
        """Look no more."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def measure(rates: list[float], source: str = "tick", seconds: float = SECONDS, *, kept: bool = True) -> list[Flood]:
    """Run these rates one after the other, on one board."""
    with board(kept=kept) as ours:
        counters = _Counters(ours.session)
        try:
            return [_flood(ours, counters, source, rate, seconds, number) for number, rate in enumerate(rates, 1)]
        finally:
            counters.close()


def _flood(ours: Board, counters: _Counters, source: str, rate: float, seconds: float, number: int) -> Flood:
    _until(lambda: len(counters.now()) > 0, PATIENCE)
    time.sleep(1.5)  # for the figures of the run before
    before, count, lines = counters.now(), round(rate * seconds), len(ours.agent.said)
    used = {one.name: one.cpu() for one in (ours.bridge, ours.agent)}
    begun = time.monotonic()
    for index in range(1, count + 1):
        if (wait := begun + index / rate - time.monotonic()) > 0:
            time.sleep(wait)
        ours.put(source, index, count)
    ended = time.monotonic()

    def done() -> list[float]:
        return [at for at, line in ours.agent.said[lines:] if f"all up to {count}" in line]

    cpu = {one.name: 100 * (one.cpu() - used[one.name]) / (ended - begun) for one in (ours.bridge, ours.agent)}
    _until(lambda: bool(done()), PATIENCE)
    ours.put("run", number)
    stood = f"run {number} stands at "
    _until(lambda: any(stood in line for _, line in ours.agent.said[lines:]), PATIENCE)
    time.sleep(1.5)  # until both have told their health
    after = counters.now()
    said = [line for _, line in ours.agent.said[lines:]]
    came = done()
    heard = [int(at) - 1 - int(less) for at, less in re.findall(rf"{stood}(\d+) without (-?\d+)", "\n".join(said))]
    return Flood(
        rate=rate,
        reached=count / (ended - begun),
        changes=count,
        heard=heard[0] if heard else 0,
        behind=came[0] - ended if came else -1.0,
        lost={name: value - before.get(name, 0) for name, value in after.items() if value > before.get(name, 0)},
        disorder=[line for line in said if " instead of " in line][:5],
        cpu=cpu,
    )


def _until(condition: Callable[[], bool], patience: float) -> bool:
    until = time.monotonic() + patience
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True
