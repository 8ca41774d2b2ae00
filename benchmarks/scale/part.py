"""Part "scale": 1 to 100 UAVs with their agents on one router: what they cost, how late things are, what is missed.

Two rows of sizes. Simulated copters fly, as `argosy run` starts them: a process each, which needs processor time of its
own. Vehicles that only talk (`benchmarks.scale.talkers`) send what copters in flight send and cost next to nothing, so
that what is measured is the product's and not its vehicles'. Daemons are started as the product starts them: one
commd, one bridged for all vehicles of a link, one agentd for all agents of a board; in a third row each vehicle has a
link, and so a bridged, of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from benchmarks import fits
from benchmarks.parts import Goal, tell
from benchmarks.scale.mission import Vehicles
from benchmarks.scale.page import DAEMONS, blocks, easy, pictures
from benchmarks.scale.run import Run, run

__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

SIZES: Final = (1, 10, 50, 100)
APART: Final = (10, 50)
"""Sizes at which each vehicle also has a bridge of its own."""
QUICK: Final = (1, 5)
SECONDS: Final = 12.0
"""For which each size is looked at."""
QUICK_SECONDS: Final = 3.0
LATE: Final = 100.0
"""Milliseconds from a position to its belief after which the next position is there already."""
STEEPEST: Final = 1.15
"""A power of the size that still counts as in proportion to it: what noise makes of 1."""


@dataclass
class Figures:
    """All runs."""

    runs: list[Run] = field(default_factory=list)

    def of(self, vehicles: Vehicles, *, own_links: bool = False) -> list[Run]:
        """Return a row of sizes, the smallest first."""
        found = [one for one in self.runs if (one.vehicles, one.own_links) == (vehicles, own_links)]
        return sorted(found, key=lambda one: one.size)


def measure(quick: bool) -> Figures:
    """Measure all sizes. Raises BenchmarkFailed."""
    sizes, seconds = (QUICK, QUICK_SECONDS) if quick else (SIZES, SECONDS)
    wanted: list[tuple[Vehicles, int, bool]] = [("talkers", size, False) for size in sizes]
    wanted += [("talkers", size, True) for size in (sizes[-1:] if quick else APART)]
    wanted += [("copters", size, False) for size in (sizes[-1:] if quick else sizes)]
    figures = Figures()
    for vehicles, size, own_links in wanted:
        found = run(vehicles, size, seconds=seconds, own_links=own_links)
        own = ", a bridge for each" if own_links else ""
        tell(
            f"{size} {vehicles}{own}: {found.serving} served, {found.cpu():.0f} % of a core, "
            f"p99 {found.percept.p99:.0f} ms"
        )
        figures.runs.append(found)
    return figures


def goals(figures: Figures) -> list[Goal]:
    """What is asked of them: that the largest fleet is served in time, and costs no more than in proportion."""
    row = figures.of("talkers")
    largest = row[-1]
    missed = {what: count for what, count in largest.missed.items() if count}
    found = [
        Goal(
            f"{largest.size} UAVs with their agents on one router: all served, no deadline missed",
            f"{largest.size}, 0 missed",
            f"{largest.serving}, {sum(missed.values())} missed",
            largest.serving == largest.size and not missed,
            "; ".join(f"{what}: {count}" for what, count in missed.items()),
        ),
        Goal(
            f"position to belief at {largest.size} UAVs, p99: before the next position comes",
            f"{LATE:g} ms",
            f"{largest.percept.p99:.0f} ms",
            largest.percept.p99 <= LATE,
            f"the cores were busy for {largest.busy:.0f} % of the time",
        ),
    ]
    told = easy(row)
    if len(told) > 2:
        powers = {kind: fits.power([(one.size, one.use[kind].cpu) for one in told]) for kind in DAEMONS}
        worst = max(powers, key=lambda kind: powers[kind])
        found.append(
            Goal(
                f"processor time of no daemon grows faster than the fleet ({told[0].size} to {told[-1].size} UAVs)",
                f"size ^ {STEEPEST:g} at most",
                f"size ^ {powers[worst]:.2f} ({worst})",
                powers[worst] <= STEEPEST,
            )
        )
    return found
