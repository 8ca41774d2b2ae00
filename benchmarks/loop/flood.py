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

from benchmarks.health import DAEMONS, Records, grown, listening
from benchmarks.loop.board import Board, board
from benchmarks.processes import BenchmarkFailed

SECONDS: Final = 4.0
"""For which a rate is kept up."""
KEEPS_UP: Final = 1.0
"""Seconds after the last change within which the last event has to be there."""
UNDER_WAY: Final = 0.3
"""Seconds that a daemon's figures may be old when they come."""
IN_TIME: Final = 0.98
"""Of the changes a second that are wanted so many have to be made: by less the rate was not tried."""
PATIENCE: Final = 8.0
"""Seconds after which events do not come any more."""
_LOST: Final = ("drops", "bad_input", "percepts_missed", "samples_dropped", "percepts_unreadable")
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
    """Per cent of a core, of each daemon, up to the last event."""

    @property
    def made(self) -> float:
        """Changes a second that count: those that were made, and no more than were wanted."""
        return min(self.rate, self.reached)

    @property
    def in_time(self) -> bool:
        """Whether the sender made the rate that was wanted."""
        return self.reached >= IN_TIME * self.rate

    @property
    def complete(self) -> bool:
        """Whether each change made its event, in order, and nothing is counted as lost."""
        return self.heard == self.changes and not self.lost and not self.disorder

    @property
    def kept_up(self) -> bool:
        """Whether that was at the rate that was wanted, and the agent was not left behind either."""
        return self.in_time and self.complete and 0 <= self.behind <= KEEPS_UP


def measure(rate: float, source: str = "tick", seconds: float = SECONDS) -> Flood:
    """Let the robot change so often a second, on a board of its own. Raises BenchmarkFailed."""
    with board() as ours, listening(ours.endpoint, "loop") as records:
        return _flood(ours, records, source, rate, seconds)


def _flood(ours: Board, records: Records, source: str, rate: float, seconds: float) -> Flood:
    _rest(records)
    count, lines = round(rate * seconds), len(ours.agent.said)
    daemons = (ours.router, ours.bridge, ours.agent)
    used = {one.name: one.cpu() for one in daemons}
    begun = time.monotonic()
    for index in range(1, count + 1):
        if (wait := begun + index / rate - time.monotonic()) > 0:
            time.sleep(wait)
        ours.put(source, index, count)
    ended = time.monotonic()

    def done() -> float:
        return ours.agent.when(f"all up to {count}", lines)

    _until(lambda: bool(done()), PATIENCE)
    spent = time.monotonic() - begun
    cpu = {one.name: 100 * (one.cpu() - used[one.name]) / spent for one in daemons}
    ours.put("run", 1)
    stood = "run 1 stands at "
    _until(lambda: bool(ours.agent.when(stood, lines)), PATIENCE)
    _rest(records)
    lost = grown(records, begun, time.monotonic())
    said = [line for _, line in ours.agent.said[lines:]]
    heard = [int(at) - 1 - int(less) for at, less in re.findall(rf"{stood}(\d+) without (-?\d+)", "\n".join(said))]
    return Flood(
        rate=rate,
        reached=count / (ended - begun),
        changes=count,
        heard=heard[0] if heard else 0,
        behind=done() - ended if done() else -1.0,
        lost={
            f"{kind}: {name}": lost[kind].counts[name] for kind in DAEMONS for name in _LOST if lost[kind].counts[name]
        },
        disorder=[line for line in said if " instead of " in line][:5],
        cpu=cpu,
    )


def _rest(records: Records) -> None:
    """Wait until bridge and agent have told their figures so much later that what was until now is in them."""
    now = time.monotonic()

    def told() -> bool:
        at = records.last()
        return len(at) > 1 and all(moment > now + UNDER_WAY for moment in at.values())

    if not _until(told, PATIENCE):
        raise BenchmarkFailed(f"no figures of bridge and agent within {PATIENCE:g} s")


def _until(condition: Callable[[], bool], patience: float) -> bool:
    until = time.monotonic() + patience
    while not condition():
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True
