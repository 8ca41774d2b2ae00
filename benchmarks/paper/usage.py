"""The paper's tables 3 and 5 anew: processor and memory of each daemon over whole missions, by either approach.

Both missions are flown at speed 1 and 5, by the AgentSpeak agents and by imperative programs in their place, in pairs
of which every second one is flown in the opposite order: what drifts on the machine meanwhile drifts for both. Each
second psutil is asked what each process used.
"""

from __future__ import annotations

from typing import Final

from benchmarks.flights import APPROACHES, RESCUE, SINGLE, Approach, Course, flying
from benchmarks.paper.usage_figures import Figures, Sampled, drawn, usage
from benchmarks.paper.usage_goals import goals
from benchmarks.paper.usage_page import blocks, in_comparison, in_short
from benchmarks.paper.usage_plots import pictures
from benchmarks.parts import tell
from benchmarks.processes import BenchmarkFailed
from benchmarks.sampling import Sampler

__all__ = ["Figures", "blocks", "flown", "goals", "in_comparison", "in_short", "measure", "pictures"]

EVERY: Final = 1.0
"""Wall seconds between two samples: as the paper's."""
ENOUGH: Final = 0.9
"""Of the samples that there should be: with fewer the machine was too busy for a row."""
TRIED: Final = 0.5
"""The same of flights that only try, on a machine that may be busy."""
FLIGHTS: Final = ((SINGLE, 1.0, 2), (SINGLE, 5.0, 3), (RESCUE, 1.0, 1), (RESCUE, 5.0, 3))
"""Mission, speed, and pairs of flights. That of search and rescue at speed 1 takes a quarter of an hour."""
QUICK: Final = ((SINGLE, 20.0, 1), (RESCUE, 25.0, 1))
COURSES: Final = {(SINGLE.mission, 1.0), (RESCUE.mission, 1.0)}
"""Whose samples are kept, to be drawn."""


def measure(quick: bool) -> Figures:
    """Fly everything. Raises BenchmarkFailed, also for a flight that was not done."""
    figures = Figures()
    every, enough = (EVERY / 2, TRIED) if quick else (EVERY, ENOUGH)
    for course, speed, pairs in QUICK if quick else FLIGHTS:
        flights: dict[Approach, list[Sampled]] = {approach: [] for approach in APPROACHES}
        lost: dict[Approach, list[str]] = {approach: [] for approach in APPROACHES}
        for pair in range(pairs):
            for approach in APPROACHES if pair % 2 == 0 else reversed(APPROACHES):
                tell(f"{course.title}, {approach}, speed {speed:g}, {pair + 1} of {pairs}")
                flights[approach].append(_once_more(course, approach, speed, every, enough, lost[approach]))
        for approach, found in flights.items():
            figures.usages.append(usage(course, speed, approach, found))
            figures.usages[-1].again = lost[approach]
            if (course.mission, speed) in COURSES:
                figures.drawn.append(drawn(course, speed, approach, found[0][1]))
    return figures


def _once_more(
    course: Course, approach: Approach, speed: float, every: float, enough: float, lost: list[str]
) -> Sampled:
    """Fly a mission, and once more if it is not done, but that once only: `lost` tells why. Raises BenchmarkFailed."""
    try:
        return flown(course, approach, speed, every, enough)
    except BenchmarkFailed as failed:
        if lost:
            raise
        lost.append(str(failed).partition("\n")[0].partition("; last:")[0])
        tell(f"flown again: {failed}")
    return flown(course, approach, speed, every, enough)


def flown(course: Course, approach: Approach, speed: float, every: float, enough: float = ENOUGH) -> Sampled:
    """Fly a mission once: return how long it took, and what was sampled. Raises BenchmarkFailed."""
    with flying(course, approach, speed) as flight:
        sampler = Sampler(flight, every)
        with sampler.sampling():
            flight.until_done()
        try:
            return flight.over - flight.up, sampler.until(flight.over, enough)
        except BenchmarkFailed as failed:
            raise BenchmarkFailed(f"{course.title}, {approach}, speed {speed:g}: {failed}") from None
