"""What the flights of `benchmarks.paper.usage` used: flight by flight, and over all flights of an approach."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from typing import Final

from benchmarks.flights import Course
from benchmarks.sampling import ROLES, Sample

ALL: Final = "ALL"
"""The boards of a mission together: each sample of each board counts, as in the paper's table 5."""
BOARD: Final = "board"
"""The processes of a board together."""
WHO: Final = (*dict.fromkeys(ROLES.values()), BOARD)
BDI, IMPERATIVE = "agentspeak", "python"


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


def drawn(course: Course, speed: float, approach: str, samples: list[Sample]) -> Drawn:
    """Return the course of one flight."""

    def means(field: str) -> dict[str, list[float]]:
        return {
            who: [
                round(statistics.mean(_of(getattr(sample, field), board, who) for board in sample.boards), 2)
                for sample in samples
            ]
            for who in WHO
        }

    return Drawn(
        course.mission, speed, approach, [round(sample.at, 2) for sample in samples], means("cpu"), means("rss")
    )
