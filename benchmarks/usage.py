"""The paper's tables 3 and 5 anew: processor and memory of each daemon over whole missions, by either approach.

Both missions are flown at speed 1 and 5, by the AgentSpeak agents and by imperative programs in their place, in pairs
of which every second one is flown in the opposite order: what drifts on the machine meanwhile drifts for both. Each
second psutil is asked what each process used.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from typing import Final

from benchmarks.flights import APPROACHES, RESCUE, SINGLE, Approach, Course, Flight, flying
from benchmarks.parts import tell
from benchmarks.processes import BenchmarkFailed, Sample, Sampler

ALL: Final = "ALL"
"""The boards of a mission together: each sample of each board counts, as in the paper's table 5."""
BOARD: Final = "board"
"""The processes of a board together."""
AGENT: Final = "agent"
ROLES: Final = {"commd": "commd", "bridged": "bridged", "agentd": AGENT, "program": AGENT}
"""What each kind of process is on its board; others are not counted."""
WHO: Final = ("commd", "bridged", AGENT, BOARD)
BDI: Final = "agentspeak"
IMPERATIVE: Final = "python"


@dataclass
class Measured:
    """A mean over whole flights; standard deviation and the highest of the samples."""

    mean: float
    std: float
    max: float


@dataclass
class Row:
    """What a process of a board used, or all of them."""

    board: str
    who: str
    """agent, bridged, commd, or `board`: together."""
    cpu: Measured
    """Per cent of one core; the mean by the processor time that was spent from the first moment to the last sample."""
    rss: Measured
    """MB (10^6 bytes) resident; what processes share counts for each."""
    pss: Measured
    """MB; what processes share is divided among them."""


@dataclass
class Flown:
    """One flight: means over it and its boards, by who."""

    seconds: float
    """Wall seconds from when all processes were there until it was done."""
    samples: int
    cpu: dict[str, float]
    rss: dict[str, float]
    alone: float | None
    """MB that its boards' processes would hold alone on machines, added up; None where the kernel is silent."""


@dataclass
class Usage:
    """What a mission used by one approach."""

    mission: str
    speed: float
    approach: str
    flights: list[Flown]
    rows: list[Row]
    alone: dict[str, float]
    """By board: MB that its processes would hold alone on a machine, in the mean; empty where the kernel is silent."""
    again: list[str] = field(default_factory=list)
    """Why flights were not done, which were flown again: one line each."""

    def row(self, who: str, board: str = ALL) -> Row:
        """Return what somebody used."""
        return next(one for one in self.rows if (one.board, one.who) == (board, who))


@dataclass
class Figures:
    """All that this part measures."""

    usages: list[Usage] = field(default_factory=list)

    def of(self, mission: str, speed: float, approach: str) -> Usage:
        """Return what a mission used. Raises StopIteration if it was not flown."""
        return next(one for one in self.usages if (one.mission, one.speed, one.approach) == (mission, speed, approach))

    def flown(self) -> list[tuple[str, float]]:
        """Return the missions and their speeds."""
        return list(dict.fromkeys((one.mission, one.speed) for one in self.usages))

    def pairs(self, mission: str, speed: float) -> list[tuple[Flown, Flown]]:
        """Return the flights that were flown one behind the other: by agents, by programs."""
        bdi, other = self.of(mission, speed, BDI), self.of(mission, speed, IMPERATIVE)
        return list(zip(bdi.flights, other.flights, strict=True))


Sampled = tuple[float, list[Sample]]
"""The wall seconds of a flight, and its samples."""


def usage(course: Course, speed: float, approach: str, flights: list[Sampled]) -> Usage:
    """Return what the flights of a mission by one approach used."""
    samples = [found for _, found in flights]
    boards = samples[0][0].boards
    return Usage(
        course.mission,
        speed,
        approach,
        [_flown(taken, found) for taken, found in flights],
        [_row(samples, board, who) for board in (ALL, *boards) for who in WHO],
        {board: round(alone, 2) for board in boards if (alone := _alone(samples, board)) is not None},
    )


def _flown(taken: float, samples: list[Sample]) -> Flown:
    rows = {who: _row([samples], ALL, who) for who in WHO}
    alone = [_alone([samples], board) for board in samples[0].boards]
    return Flown(
        round(taken, 1),
        len(samples),
        {who: row.cpu.mean for who, row in rows.items()},
        {who: row.rss.mean for who, row in rows.items()},
        round(sum(one for one in alone if one is not None), 2) if None not in alone else None,
    )


def _alone(flights: list[list[Sample]], board: str) -> float | None:
    told = [sample.alone[board] for samples in flights for sample in samples if board in sample.alone]
    return statistics.mean(told) if told else None


def _row(flights: list[list[Sample]], board: str, who: str) -> Row:
    boards = flights[0][0].boards if board == ALL else [board]

    def measured(field: str) -> Measured:
        values = [
            _of(getattr(sample, field), where, who) for samples in flights for sample in samples for where in boards
        ]
        return _rounded(statistics.mean(values), statistics.pstdev(values), max(values))

    cpu = measured("cpu")
    spent = sum(_of(samples[-1].spent, where, who) for samples in flights for where in boards)
    passed = sum(samples[-1].at for samples in flights) * len(boards)
    return Row(board, who, _rounded(100 * spent / passed, cpu.std, cpu.max), measured("rss"), measured("pss"))


def _rounded(*values: float) -> Measured:
    return Measured(*(round(one, 3) for one in values))


def _of(values: dict[tuple[str, str], float], board: str, who: str) -> float:
    return sum(value for (where, whose), value in values.items() if where == board and who in (whose, BOARD))


EVERY: Final = 1.0
"""Wall seconds between two samples: as the paper's."""
ENOUGH: Final = 0.9
"""Of the samples that there should be: with fewer the machine was too busy for a row."""
TRIED: Final = 0.5
"""The same of flights that only try, on a machine that may be busy."""
FLIGHTS: Final = ((SINGLE, 1.0, 2), (SINGLE, 5.0, 3), (RESCUE, 1.0, 1), (RESCUE, 5.0, 3))
"""Mission, speed, and pairs of flights. That of search and rescue at speed 1 takes a quarter of an hour."""
QUICK: Final = ((SINGLE, 20.0, 1), (RESCUE, 25.0, 1))


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
    return figures


def probe(quick: bool) -> dict[str, float]:
    """Return what the single-UAV mission costs its board and its agent's process: less is better."""
    speed, every, enough = (20.0, EVERY / 2, TRIED) if quick else (1.0, EVERY, ENOUGH)
    found = usage(SINGLE, speed, BDI, [flown(SINGLE, BDI, speed, every, enough)])
    return {
        f"{SINGLE.title}, {who}, {what}": value
        for who in (BOARD, AGENT)
        for what, value in (("processor (% of a core)", found.row(who).cpu.mean), ("RSS (MB)", found.row(who).rss.mean))
    }


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


def daemons(flight: Flight) -> dict[tuple[str, str], int]:
    """Return the number of each process that counts, by its board and what it is there."""
    return {
        (process.board, ROLES[process.kind.name]): watched.process.pid
        for process, watched in flight.watched
        if process.kind.name in ROLES
    }


def flown(course: Course, approach: Approach, speed: float, every: float, enough: float = ENOUGH) -> Sampled:
    """Fly a mission once: return how long it took, and what was sampled. Raises BenchmarkFailed."""
    with flying(course, approach, speed) as flight:
        sampler = Sampler(daemons(flight), every)
        with sampler.sampling():
            flight.until_done()
        try:
            return flight.over - flight.up, sampler.until(flight.over, enough)
        except BenchmarkFailed as failed:
            raise BenchmarkFailed(f"{course.title}, {approach}, speed {speed:g}: {failed}") from None
