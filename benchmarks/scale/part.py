"""Part "scale": 1 to 100 UAVs with their agents on one router: what they cost, how late things are, what is missed.

Two rows of sizes. Simulated copters fly, as `argosy run` starts them: a process each, which needs processor time of its
own. Vehicles that only talk (`benchmarks.scale.mission`) send what copters send that fly a circle and cost next to
nothing, so that what is measured is the product's and not its vehicles'. Daemons are started as the product starts
them: one commd, one bridged for all vehicles of a link, one agentd for all agents of a board; in a third row each
vehicle has a link, and so a bridged, of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from benchmarks import spread as fits
from benchmarks.parts import Goal, tell
from benchmarks.scale.mission import Vehicles
from benchmarks.scale.page import DAEMONS, FULL, blocks, easy, pictures
from benchmarks.scale.run import IN_TIME, LATE, Run, run

__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

SIZES: Final = (1, 10, 50, 100)
BETWEEN: Final = 25
"""One size more for vehicles that only talk: a growth is told by those sizes that leave cores free."""
APART: Final = (10, 50)
"""Sizes at which each vehicle also has a bridge of its own."""
QUICK: Final = (1, 5)
SECONDS: Final = 12.0
"""For which each size is looked at."""
QUICK_SECONDS: Final = 3.0


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
    wanted: list[tuple[Vehicles, int, bool]] = [
        ("talkers", size, False) for size in (sizes if quick else sorted((*sizes, BETWEEN)))
    ]
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
    copters = figures.of("copters")[-1]
    found = [
        _served(largest, f"{largest.size} UAVs that only talk, with their agents, on one router", _why(largest)),
        Goal(
            f"positions of {largest.size} UAVs that only talk: beliefs before the next ({LATE:g} ms), of all sent",
            f"{IN_TIME:.0%}",
            f"{largest.in_time:.1%} (p99 of those that came: {largest.percept.p99:.0f} ms)",
            largest.in_time >= IN_TIME,
            _why(largest),
        ),
        _served(
            copters,
            f"{copters.size} simulated copters with their agents on one machine",
            f"{_SIMULATORS}; {_why(copters)}",
            others=1,  # that only talks, for the latency
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


def _served(one: Run, title: str, why: str, others: int = 0) -> Goal:
    """Return the goal that all agents of a size served and nothing was missed; `others` are vehicles beside them."""
    serving, missed = one.serving - others, sum(one.missed.values())
    return Goal(
        f"{title}: all served, no deadline missed",
        f"{one.size}, 0 missed",
        f"{serving}, {missed} missed",
        serving == one.size and not missed,
        why,
    )


def _why(one: Run) -> str:
    """Return why that size was not served in time, as far as its own figures tell, and what was tried."""
    what = "; ".join(one.not_served()) or "nothing was late or lost"
    reason = (
        f"the cores were busy for {one.busy:.0f} % of the time"
        if one.busy >= FULL
        else f"the cores were busy for {one.busy:.0f} % of the time, so the reason is not known"
    )
    return f"{what}; {reason}. {_TRIED}"


_SIMULATORS: Final = "each simulator is a process that wants processor time of this machine, too"
_TRIED: Final = (
    "Tried: a link remembers as many vehicles as it may have and asks for a receive buffer by their number, keys used "
    "again are declared once, manifests are read once for all robots"
)
_TRIED_GROWTH: Final = (
    "What Zenoh does for a record grows with all that is declared on its session. Tried: keys used again are declared "
    "once, which took most of that away; what grows in the rest is not known"
)
