"""The paper's tables 3 and 5 anew: processor and memory of each daemon over whole missions, by either approach.

Both missions are flown at speed 1 and 5, by the AgentSpeak agents and by imperative programs in their place, in turns:
what drifts on the machine meanwhile drifts for both. Each second psutil is asked what each process used.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from typing import Final

from benchmarks.flights import APPROACHES, RESCUE, SINGLE, Approach, Course, flying
from benchmarks.parts import Goal, tell
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import Origin
from benchmarks.sampling import ROLES, Sample, Sampler

EVERY: Final = 1.0
"""Wall seconds between two samples: as the paper's."""
ENOUGH: Final = 0.5
"""Of the samples that there should be: with fewer the machine was too busy for a row."""
FLIGHTS: Final = ((SINGLE, 1.0, 2), (SINGLE, 5.0, 2), (RESCUE, 1.0, 1), (RESCUE, 5.0, 1))
"""Mission, speed, and flights of each approach."""
QUICK: Final = ((SINGLE, 20.0, 1), (RESCUE, 25.0, 1))
COURSES: Final = {(SINGLE.mission, 1.0), (RESCUE.mission, 1.0)}
"""Whose samples are kept, to be drawn."""
ALL: Final = "ALL"
"""The boards of a mission together: each sample of each board counts, as in the paper's table 5."""
BOARD: Final = "board"
"""The processes of a board together."""


@dataclass
class Spread:
    """What was sampled: mean, standard deviation and the highest."""

    mean: float
    std: float
    max: float


@dataclass
class Row:
    """What a process of a board used, or all of them."""

    board: str
    who: str
    """agent, bridged, commd, or `board`: together."""
    cpu: Spread
    """Per cent of one core."""
    rss: Spread
    """MB (10^6 bytes) resident; what processes share counts for each."""
    pss: Spread
    """MB; what processes share is divided among them."""


@dataclass
class Usage:
    """What a mission used by one approach."""

    mission: str
    speed: float
    approach: str
    seconds: list[float]
    """Wall seconds of each flight, from when all processes were there until it was done."""
    samples: int
    """In time, of all flights together."""
    rows: list[Row]
    alone: dict[str, float]
    """By board: MB that its processes would hold alone on a machine, in the mean; empty where the kernel is silent."""
    by_flight: list[float]
    """CPU of a board in the mean of each flight, to see how far flights differ."""
    again: list[str] = field(default_factory=list)
    """Why flights were not done, which were flown again."""

    def row(self, who: str, board: str = ALL) -> Row:
        """Return what somebody used."""
        return next(one for one in self.rows if (one.board, one.who) == (board, who))


@dataclass
class Drawn:
    """The samples of one flight: means over its boards."""

    mission: str
    speed: float
    approach: str
    at: list[float]
    """Seconds since all processes were there."""
    cpu: dict[str, list[float]]
    """By who: agent, bridged, commd, board."""
    rss: dict[str, list[float]]


@dataclass
class Figures:
    """All that this part measures."""

    usages: list[Usage] = field(default_factory=list)
    drawn: list[Drawn] = field(default_factory=list)

    def of(self, mission: str, speed: float, approach: str) -> Usage:
        """Return what a mission used. Raises StopIteration if it was not flown."""
        return next(one for one in self.usages if (one.mission, one.speed, one.approach) == (mission, speed, approach))

    def flown(self) -> list[tuple[str, float]]:
        """Return the missions and their speeds."""
        return list(dict.fromkeys((one.mission, one.speed) for one in self.usages))


def measure(quick: bool) -> Figures:
    """Fly everything. Raises BenchmarkFailed, also for a flight that was not done."""
    figures = Figures()
    for course, speed, times in QUICK if quick else FLIGHTS:
        flights: dict[Approach, list[tuple[float, list[Sample]]]] = {approach: [] for approach in APPROACHES}
        lost: dict[Approach, list[str]] = {approach: [] for approach in APPROACHES}
        for _ in range(times):
            for approach in APPROACHES:
                tell(f"{course.title}, {approach}, speed {speed:g}")
                flights[approach].append(
                    _once_more(course, approach, speed, EVERY / 2 if quick else EVERY, lost[approach])
                )
        for approach, found in flights.items():
            figures.usages.append(usage(course, speed, approach, found))
            figures.usages[-1].again = lost[approach]
            if (course.mission, speed) in COURSES:
                figures.drawn.append(drawn(course, speed, approach, found[0][1]))
    return figures


def _once_more(
    course: Course, approach: Approach, speed: float, every: float, lost: list[str]
) -> tuple[float, list[Sample]]:
    """Fly a mission, and once more if it is not done: `lost` tells why. Raises BenchmarkFailed."""
    try:
        return flown(course, approach, speed, every)
    except BenchmarkFailed as failed:
        if lost:
            raise
        lost.append(str(failed).partition("; last:")[0])
        tell(f"flown again: {failed}")
    return flown(course, approach, speed, every)


def flown(course: Course, approach: Approach, speed: float, every: float) -> tuple[float, list[Sample]]:
    """Fly a mission once: return how long it took, and what was sampled. Raises BenchmarkFailed."""
    with flying(course, approach, speed) as flight:
        sampler = Sampler(flight, every)
        with sampler.sampling():
            flight.until_done()
        taken = flight.over - flight.up
        if len(sampler.samples) < ENOUGH * taken / every - 2:
            raise BenchmarkFailed(f"{course.title}: only {len(sampler.samples)} samples in {taken:.0f} s")
        return taken, sampler.samples


def usage(course: Course, speed: float, approach: str, flights: list[tuple[float, list[Sample]]]) -> Usage:
    """Return what the flights of a mission by one approach used."""
    samples = [sample for _, found in flights for sample in found]
    boards = samples[0].boards
    told = [(board, value) for sample in samples for board, value in sample.alone.items()]
    return Usage(
        course.mission,
        speed,
        approach,
        [round(taken, 1) for taken, _ in flights],
        len(samples),
        [_row(samples, board, who) for board in (ALL, *boards) for who in (*dict.fromkeys(ROLES.values()), BOARD)],
        {board: round(statistics.mean(found), 2) for board in boards if (found := [v for b, v in told if b == board])},
        [round(_row(found, ALL, BOARD).cpu.mean, 3) for _, found in flights],
    )


def _row(samples: list[Sample], board: str, who: str) -> Row:
    def spread(field: str) -> Spread:
        values = [
            _of(getattr(sample, field), where, who)
            for sample in samples
            for where in (sample.boards if board == ALL else [board])
        ]
        return Spread(*(round(one, 3) for one in (statistics.mean(values), statistics.pstdev(values), max(values))))

    return Row(board, who, spread("cpu"), spread("rss"), spread("pss"))


def _of(values: dict[tuple[str, str], float], board: str, who: str) -> float:
    return sum(value for (where, whose), value in values.items() if where == board and who in (whose, BOARD))


def drawn(course: Course, speed: float, approach: str, samples: list[Sample]) -> Drawn:
    """Return the course of one flight."""

    def means(field: str) -> dict[str, list[float]]:
        return {
            who: [
                round(statistics.mean(_of(getattr(sample, field), board, who) for board in sample.boards), 2)
                for sample in samples
            ]
            for who in (*dict.fromkeys(ROLES.values()), BOARD)
        }

    return Drawn(
        course.mission, speed, approach, [round(sample.at, 2) for sample in samples], means("cpu"), means("rss")
    )


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked: the BDI approach beside the imperative one."""
    from benchmarks.paper import usage_page

    return usage_page.goals(figures)


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    from benchmarks.paper import usage_page

    return usage_page.blocks(origin, figures)


def pictures(figures: Figures) -> dict[str, str]:
    """Return the plots."""
    from benchmarks.paper import usage_plots

    return usage_plots.pictures(figures)


def in_short(figures: Figures) -> list[str]:
    """Return rows for README."""
    from benchmarks.paper import usage_page

    return usage_page.in_short(figures)


def in_comparison(figures: Figures) -> list[str]:
    """Return rows for docs/comparison.md."""
    from benchmarks.paper import usage_page

    return usage_page.in_comparison(figures)
