"""Part "scale": 1 to 100 vehicles with their agents on one router: what they cost, how late, what is missed.

Vehicles that only talk (`benchmarks.scale.mission`) send what copters send that fly a circle and cost next to nothing,
so that the measurement is the product's and not its vehicles'. Daemons are started as the product starts them: one
commd, one bridged for all vehicles of a link, one agentd for all agents of a board; in a second row each vehicle has a
link, and so a bridged, of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from benchmarks import spread as fits
from benchmarks.parts import Goal, tell
from benchmarks.results import Origin
from benchmarks.scale.page import FULL, easy, page, picture
from benchmarks.scale.run import DAEMONS, IN_TIME, LATE, Run, run

SIZES: Final = (1, 10, 25, 50, 100)
APART: Final = (10, 50)
"""Sizes at which each vehicle also has a bridge of its own."""
QUICK: Final = (1, 5)
SECONDS: Final = 12.0
"""For which each size is observed."""
QUICK_SECONDS: Final = 3.0


@dataclass
class Figures:
    """All runs."""

    runs: list[Run] = field(default_factory=list)

    def row(self, *, own_links: bool = False) -> list[Run]:
        """Return a row of sizes, the smallest first."""
        return sorted((one for one in self.runs if one.own_links == own_links), key=lambda one: one.size)


def measure(quick: bool) -> Figures:
    """Measure all sizes. Raises BenchmarkFailed."""
    sizes, apart, seconds = (QUICK, QUICK[-1:], QUICK_SECONDS) if quick else (SIZES, APART, SECONDS)
    figures = Figures()
    for size, own_links in [*((size, False) for size in sizes), *((size, True) for size in apart)]:
        found = run(size, seconds=seconds, own_links=own_links)
        own = ", a bridge for each" if own_links else ""
        tell(f"{size}{own}: {found.serving} served, {found.cpu():.0f} % of a core, p99 {found.percept.p99:.0f} ms")
        figures.runs.append(found)
    return figures


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of docs/measurements/scaling.md."""
    return {"scale": page(origin, figures.row(), figures.row(own_links=True))}


def pictures(figures: Figures) -> dict[str, str]:
    """Return its picture."""
    return {"scale-cost": picture(figures.row())}


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked: that the largest fleet is served in time, and costs no more than in proportion."""
    row = figures.row()
    largest = row[-1]
    missed = sum(largest.missed.values())
    found = [
        Goal(
            f"{largest.size} UAVs that only talk, with their agents, on one router: all served, no deadline missed",
            f"{largest.size}, 0 missed",
            f"{largest.serving}, {missed} missed",
            largest.serving == largest.size and not missed,
            _why(largest),
        ),
        Goal(
            f"positions of {largest.size} UAVs that only talk: beliefs before the next ({LATE:g} ms), of all sent",
            f"{IN_TIME:.0%}",
            f"{largest.in_time:.1%} (p99 of those that came: {largest.percept.p99:.0f} ms)",
            largest.in_time >= IN_TIME,
            _why(largest),
        ),
    ]
    told = easy(row)
    if len(told) >= fits.SIZES:
        powers = {kind: fits.power([(one.size, one.use[kind].cpu) for one in told]) for kind in DAEMONS}
        worst = max(powers, key=lambda kind: powers[kind].power)
        found.append(
            Goal(
                f"processor time of no daemon grows faster than the fleet ({told[0].size} to {told[-1].size} UAVs)",
                f"size ^ {fits.STEEPEST:g} at most",
                f"{powers[worst]} ({worst}; off by {powers[worst].off:.0%} at worst)",
                powers[worst].power <= fits.STEEPEST,
                _TRIED_GROWTH,
            )
        )
    else:
        few = f"{len(told)} sizes left cores free, and a growth is told by {fits.SIZES}: it is not known"
        found.append(Goal("processor time of no daemon grows faster than the fleet", "", "", False, few, decided=False))
    return found


def _why(one: Run) -> str:
    """Return why that size was not served in time, as far as its own figures tell, and what was tried."""
    what = "; ".join(one.not_served()) or "nothing was late or lost"
    reason = (
        f"the cores were busy for {one.busy:.0f} % of the time"
        if one.busy >= FULL
        else f"the cores were busy for {one.busy:.0f} % of the time, so the reason is not known"
    )
    return f"{what}; {reason}. {_TRIED}"


_TRIED: Final = (
    "Tried: a link remembers as many vehicles as it may have and asks for a receive buffer by their number, keys used "
    "again are declared once, manifests are read once for all robots"
)
_TRIED_GROWTH: Final = (
    "What Zenoh does for a record grows with all that is declared on its session. Tried: keys used again are declared "
    "once, which took most of that away; what grows in the rest is not known"
)
