"""Part "crowd": 1 to 1,000 agents in one agentd, as agents of a fleet are: mail on disk, checkpoints, health.

Agents sit in a ring: each asks the one behind it for a belief, and waits for the answer. Every question and every
answer is a message through the board's commd, written down by sender, board and receiver.
"""

from __future__ import annotations

import asyncio
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks import fits
from benchmarks.crowd.page import blocks, pictures
from benchmarks.crowd.run import ANSWERING, Crowd, crowd
from benchmarks.disk import fsync
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
    figures = Figures(fsync=fsync(), pace=3.0 if quick else PACE)
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
    last = largest.hurried
    found = [
        Goal(
            f"{largest.agents:,} agents in one agentd exchange messages: questions answered within {ANSWERING:g} s",
            f"all {last.asked:,}" if last else "all",
            f"{last.answered:,}" if last else "not measured",
            last is not None and last.all_answered,
            _DECLARED,
        )
    ]
    if len(figures.crowds) < fits.SIZES:
        return found
    for what, points in (
        ("memory of an agentd grows no faster than its agents", [(one.agents, one.rss) for one in figures.crowds]),
        ("so does the processor time of its start", [(one.agents, one.cpu_start) for one in figures.crowds]),
    ):
        growth = fits.power([(float(size), cost) for size, cost in points])
        told = f"{growth} (off by {growth.off:.0%} at worst)"
        found.append(Goal(what, f"size ^ {fits.STEEPEST:g} at most", told, growth.power <= fits.STEEPEST, _GROWS))
    rates = [one.hurried.rate for one in figures.crowds if one.hurried is not None]
    part = rates[-1] / max(rates) if last is not None and rates else 0.0
    found.append(
        Goal(
            f"messages a second among {largest.agents:,} agents, against the most of any crowd",
            f"{KEPT:.0%}",
            f"{part:.0%}",
            part >= KEPT,
            _DECLARED,
        )
    )
    return found


_DECLARED: Final = (
    "What the router of Zenoh does for a record, above all for one that nobody hears, grows with all that is declared; "
    "each agent declares keys of its own, and tells its health each second. Tried: keys that are used again are "
    "declared once, agents take turns to ask commd and to write to it. Not tried: health told more rarely in a crowd. "
    "The larger a crowd, the fewer questions each of its agents asks, so that first words weigh more in it"
)
_GROWS: Final = (
    "Which part of an agent grows with the number of the others is not known. Tried: manifests are read once for all "
    "robots, keys that are used again are declared once"
)
