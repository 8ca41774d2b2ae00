"""The decision loop, percept -> belief -> plan -> action -> status, through the real daemons (`benchmarks.parts`).

What is measured in one round trip of the loop, and by which bare exchange each of its ways is counted:

1. the robot's sample to the bridge, the percept to the agent: two puts, as a bare put and its being put back;
2. the action to the bridge, its status to the agent: a query and its reply, as a bare query and its reply.

The bare exchanges are made by two Python processes through the same router, with payloads of the same sizes, in turn
with the loop.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from benchmarks.loop import flood, latency
from benchmarks.loop.flood import SECONDS, Flood
from benchmarks.loop.latency import sizes
from benchmarks.loop.page import Figures, blocks, goals, in_short, pictures

__all__ = ["Figures", "blocks", "goals", "in_short", "measure", "pictures"]

TURNS: Final = 1000
RATES: Final = (1050.0, 2000.0, 3000.0, 4000.0, 6000.0)
"""Changes a second, until some are lost; the first is a little above what is asked, as no sender is quite in time."""


def measure(quick: bool) -> Figures:
    """Run everything once. Raises BenchmarkFailed."""
    count, seconds = (20, 0.5) if quick else (TURNS, SECONDS)
    carried = sizes()
    return Figures(
        bytes={
            "sample": carried.sample,
            "percept": carried.perception,
            "action": carried.action,
            "status": carried.status,
        },
        kept=latency.measure(count),
        fresh=latency.measure(count, kept=False),
        stamped=latency.measure(count, stamped=True),
        hurried=latency.measure(count, pause=0.0),
        replaced=list(_floods("tick", [100.0] if quick else RATES, seconds)),
        added=list(_floods("mark", [100.0] if quick else RATES, seconds)),
    )


def _floods(source: str, rates: Sequence[float], seconds: float) -> Iterator[Flood]:
    """Raise the rate until changes are lost."""
    for rate in rates:
        (found,) = flood.measure([rate], source, seconds)
        yield found
        if not found.kept_up:
            return
