"""Part "crowd": 1 to 1,000 agents in one agentd, as agents of a fleet are: mail on disk, checkpoints, health.

Agents sit in a ring: each asks the one behind it for a belief, and waits for the answer. Every question and every
answer is a message through the board's commd, written down by sender, board and receiver.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks import fits
from benchmarks.crowd.page import blocks, pictures
from benchmarks.crowd.run import Crowd, crowd
from benchmarks.parts import Goal, tell

__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

SIZES: Final = (1, 10, 100, 300, 1000)
QUICK: Final = (1, 10)
QUESTIONS: Final = 1_000
"""That all agents together ask as fast as they can."""
EACH_MOST: Final = 100
PACE: Final = 20.0
"""Seconds within which each agent of a crowd at its ease asks one question."""
IDLE: Final = 5.0
"""Seconds over which a crowd that does nothing is measured."""
STEEPEST: Final = 1.15
"""A power of the size that still counts as in proportion to it: what noise makes of 1."""
KEPT: Final = 0.5
"""So large a part of the most messages a second is to be left with the most agents."""


@dataclass
class Figures:
    """What the part measures."""

    crowds: list[Crowd] = field(default_factory=list)
    fsync: float = 0.0
    """Milliseconds of one on this disk."""
    pace: float = PACE


def measure(quick: bool) -> Figures:
    """Start one crowd after the other. Raises BenchmarkFailed."""
    figures = Figures(fsync=_fsync(), pace=3.0 if quick else PACE)
    for agents in QUICK if quick else SIZES:
        each = min(5 if quick else EACH_MOST, max(1, round(QUESTIONS / agents)))
        with tempfile.TemporaryDirectory() as folder:
            found = asyncio.run(crowd(Path(folder), agents, 1.0 if quick else IDLE, each, figures.pace))
        figures.crowds.append(found)
        rate = f", {found.hurried.rate:.0f} messages/s" if found.hurried else ""
        tell(f"{agents} agents: started in {found.start:.1f} s, {found.rss:.0f} MB{rate}")
    return figures


def goals(figures: Figures) -> list[Goal]:
    """What is asked: that the largest crowd talks at all, and that an agent more costs what the last one did."""
    largest = figures.crowds[-1]
    talking = [one for one in figures.crowds if one.hurried is not None]
    found = [
        Goal(
            f"{largest.agents:,} agents in one agentd exchange messages",
            "all are answered",
            "all were" if largest.hurried is not None else "not measured",
            largest.hurried is not None,
        )
    ]
    if len(figures.crowds) > 2:
        for what, points in (
            ("memory of an agentd grows no faster than its agents", [(one.agents, one.rss) for one in figures.crowds]),
            ("so does the processor time of its start", [(one.agents, one.cpu_start) for one in figures.crowds]),
        ):
            power = fits.power([(float(size), cost) for size, cost in points])
            found.append(
                Goal(what, f"size ^ {STEEPEST:g} at most", f"size ^ {power:.2f}", power <= STEEPEST, _DECLARED)
            )
        rates = [one.hurried.rate for one in talking if one.hurried is not None]
        found.append(
            Goal(
                f"messages a second among {largest.agents:,} agents, against the most of any crowd",
                f"{KEPT:.0%}",
                f"{rates[-1] / max(rates):.0%}",
                rates[-1] >= KEPT * max(rates),
                _DECLARED,
            )
        )
    return found


_DECLARED: Final = (
    "Each agent declares a dozen keys, and what Zenoh does for a declaration and for a record on its way through the "
    "router grows with all that is declared. Tried: keys used again are declared once, agents take turns to ask commd"
)


def _fsync() -> float:
    """Milliseconds of an fsync of 4 kB, the median of 50."""
    with tempfile.NamedTemporaryFile() as file:
        values = []
        for _ in range(50):
            file.write(bytes(4096))
            file.flush()
            begun = time.perf_counter()
            os.fsync(file.fileno())
            values.append(1000 * (time.perf_counter() - begun))
    return statistics.median(values)
