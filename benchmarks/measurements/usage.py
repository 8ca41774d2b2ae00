"""Part `usage`: processor and memory of each daemon over whole missions, as in the paper's tables 3 and 5.

Both missions are flown at speed 1 and 5, by the AgentSpeak agents and by imperative programs in their place, in pairs
of which every second one is flown in the opposite order: a drift of the machine affects both. psutil reads the use of
each process once a second.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field
from typing import Final

from benchmarks import peers
from benchmarks.flights import APPROACHES, RESCUE, SINGLE, Approach, Course, Flight, flying
from benchmarks.parts import Goal, progress, row, table
from benchmarks.processes import BenchmarkFailed, Sample, Sampler
from benchmarks.results import Origin

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
class MeanStdMax:
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
    cpu: MeanStdMax
    """Per cent of one core; the mean by the processor time that was spent from the first moment to the last sample."""
    rss: MeanStdMax
    """MB (10^6 bytes) resident; what processes share counts for each."""
    pss: MeanStdMax
    """MB; what processes share is divided among them."""


@dataclass
class FlightUsage:
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
    flights: list[FlightUsage]
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

    def missions(self) -> list[tuple[str, float]]:
        """Return the missions and their speeds."""
        return list(dict.fromkeys((one.mission, one.speed) for one in self.usages))

    def pairs(self, mission: str, speed: float) -> list[tuple[FlightUsage, FlightUsage]]:
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
        [_flight_usage(taken, found) for taken, found in flights],
        [_row(samples, board, who) for board in (ALL, *boards) for who in WHO],
        {board: round(alone, 2) for board in boards if (alone := _alone(samples, board)) is not None},
    )


def _flight_usage(taken: float, samples: list[Sample]) -> FlightUsage:
    rows = {who: _row([samples], ALL, who) for who in WHO}
    alone = [_alone([samples], board) for board in samples[0].boards]
    return FlightUsage(
        round(taken, 1),
        len(samples),
        {who: row.cpu.mean for who, row in rows.items()},
        {who: row.rss.mean for who, row in rows.items()},
        round(sum(one for one in alone if one is not None), 2) if None not in alone else None,
    )


def _alone(flights: list[list[Sample]], board: str) -> float | None:
    found = [sample.alone[board] for samples in flights for sample in samples if board in sample.alone]
    return statistics.mean(found) if found else None


def _row(flights: list[list[Sample]], board: str, who: str) -> Row:
    boards = flights[0][0].boards if board == ALL else [board]

    def statistic(field: str) -> MeanStdMax:
        values = [
            _of(getattr(sample, field), where, who) for samples in flights for sample in samples for where in boards
        ]
        return _rounded(statistics.mean(values), statistics.pstdev(values), max(values))

    cpu = statistic("cpu")
    spent = sum(_of(samples[-1].spent, where, who) for samples in flights for where in boards)
    passed = sum(samples[-1].at for samples in flights) * len(boards)
    return Row(board, who, _rounded(100 * spent / passed, cpu.std, cpu.max), statistic("rss"), statistic("pss"))


def _rounded(*values: float) -> MeanStdMax:
    return MeanStdMax(*(round(one, 3) for one in values))


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
                progress(f"{course.title}, {approach}, speed {speed:g}, {pair + 1} of {pairs}")
                flights[approach].append(_once_more(course, approach, speed, every, enough, lost[approach]))
        for approach, found in flights.items():
            figures.usages.append(usage(course, speed, approach, found))
            figures.usages[-1].again = lost[approach]
    return figures


def probe(quick: bool) -> dict[str, float]:
    """Return what the single-UAV mission costs its board and its agent's process: less is better."""
    speed, every, enough = (20.0, EVERY / 2, TRIED) if quick else (1.0, EVERY, ENOUGH)
    found = usage(SINGLE, speed, BDI, [fly(SINGLE, BDI, speed, every, enough)])
    return {
        f"{SINGLE.title}, {who}, {what}": value
        for who in (BOARD, AGENT)
        for what, value in (("processor (% of a core)", found.row(who).cpu.mean), ("RSS (MB)", found.row(who).rss.mean))
    }


def _once_more(
    course: Course, approach: Approach, speed: float, every: float, enough: float, lost: list[str]
) -> Sampled:
    """Fly a mission, and once more if it is not done, but only once: `lost` gets the reason. Raises BenchmarkFailed."""
    try:
        return fly(course, approach, speed, every, enough)
    except BenchmarkFailed as failed:
        if lost:
            raise
        lost.append(str(failed).partition("\n")[0].partition("; last:")[0])
        progress(f"flown again: {failed}")
    return fly(course, approach, speed, every, enough)


def daemons(flight: Flight) -> dict[tuple[str, str], int]:
    """Return the number of each process that counts, by its board and what it is there."""
    return {
        (process.board, ROLES[process.kind.name]): watched.process.pid
        for process, watched in flight.watched
        if process.kind.name in ROLES
    }


def fly(course: Course, approach: Approach, speed: float, every: float, enough: float = ENOUGH) -> Sampled:
    """Fly a mission once: return how long it took, and what was sampled. Raises BenchmarkFailed."""
    with flying(course, approach, speed) as flight:
        sampler = Sampler(daemons(flight), every)
        with sampler.sampling():
            flight.until_done()
        try:
            return flight.over - flight.up, sampler.until(flight.over, enough)
        except BenchmarkFailed as failed:
            raise BenchmarkFailed(f"{course.title}, {approach}, speed {speed:g}: {failed}") from None


TITLES: Final = {SINGLE.mission: "single UAV", RESCUE.mission: "search and rescue"}
BOARD_MEMORY, BOARD_CPU = 1.1, 1.05
AGENT_MEMORY, AGENT_CPU = 1.3, 1.2
"""Times what imperative programs use that agents may use."""
ONE_PAIR: Final = "; of one pair of flights"
CPU: Final = "CPU"
DOUBT: Final = 0.1
"""By so much may the processor time of a single pair be off by chance: pairs of the same flights differ as much."""
_CPU: Final = (
    "Counted in flight (single UAV, ce18aa4f, 2026-11-29, after the flights of this table) the agent takes 26,800 "
    "instructions of Python a second, the program 17,800, nearly all of them for the bus and passes of its loop; of "
    "the difference the mind takes 38 %, passes of the loop 30 %, health and supervision 14 %, handing percepts over "
    "13 %, records 4 %. Tried: of percepts that nothing waits for the mind is given the newest, every 2 s (07ad4de, "
    "c6d72209); an action takes no task and no timer (ff4f45a); what is to be kept is looked for only when more than "
    "percepts came (4f513ce)"
)
_MEMORY: Final = (
    "Taken to be the reason, not measured apart: the agent's process holds language, reasoner and checkpoint (SQLite) "
    "besides what a program needs. Tried: no modules that nobody needs (4bd9879, kept by tests/test_imports.py)"
)


@dataclass(frozen=True)
class Ratio:
    """What agents use beside programs: in the mean, and of each pair of flights."""

    what: str
    limit: float
    whole: float
    pairs: list[float]

    @property
    def missed(self) -> bool:
        return min(self.pairs) > self.limit and not self.open

    @property
    def open(self) -> bool:
        """Whether pairs stand on both sides of what is asked, or a single one, of processor time, close to it."""
        if len(self.pairs) == 1 and self.what == CPU:
            return abs(self.pairs[0] / self.limit - 1) <= DOUBT
        return min(self.pairs) <= self.limit < max(self.pairs)

    def __str__(self) -> str:
        each = f" ({', '.join(f'{one:.2f}x' for one in self.pairs)})" if len(self.pairs) > 1 else ""
        return f"{self.what} {self.whole:.2f}x{each}"


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of each mission at each speed. What pairs of flights answer differently is not decided."""
    return [_goal(figures, mission, speed, who) for mission, speed in figures.missions() for who in (BOARD, AGENT)]


def _goal(figures: Figures, mission: str, speed: float, who: str) -> Goal:
    memory, cpu = (BOARD_MEMORY, BOARD_CPU) if who == BOARD else (AGENT_MEMORY, AGENT_CPU)
    whose = "a board" if who == BOARD else "the agent's process"
    ratios = _ratios(figures, mission, speed, who, memory, cpu)
    missed, doubtful = [one for one in ratios if one.missed], [one for one in ratios if one.open]
    met, why = not missed and not doubtful, ""
    if missed:
        why = _why(figures.of(mission, speed, BDI), figures.of(mission, speed, IMPERATIVE), who, missed)
    elif doubtful:
        why = "; ".join(map(_span, doubtful))
        why += ": from one flight to the next more changes than what it is off by. "
        why += "Tried: pairs in changing order, means by what was spent"
    return Goal(
        f"{TITLES[mission]}, speed {speed:g}: {whose} in AgentSpeak beside Python",
        f"memory ≤ {memory:g}x, CPU ≤ {cpu:g}x",
        ", ".join(map(str, ratios))
        + (ONE_PAIR if len(ratios[0].pairs) == 1 else "")
        + _lost_flights(figures, mission, speed),
        met,
        why,
        decided=met or bool(missed),
    )


def _span(ratio: Ratio) -> str:
    if len(ratio.pairs) == 1:
        return f"{ratio.what} of one pair, {ratio.whole:.2f}x, within {DOUBT:.0%} of what is asked"
    return f"{ratio.what} of the pairs {min(ratio.pairs):.2f}x to {max(ratio.pairs):.2f}x"


def _ratios(figures: Figures, mission: str, speed: float, who: str, memory: float, cpu: float) -> list[Ratio]:
    bdi, other = (figures.of(mission, speed, approach) for approach in (BDI, IMPERATIVE))
    pairs = figures.pairs(mission, speed)
    mine, its = bdi.row(who), other.row(who)
    found = [Ratio("RSS", memory, mine.rss.mean / its.rss.mean, [one.rss[who] / two.rss[who] for one, two in pairs])]
    if who == BOARD and (whole := alone(bdi, other)) is not None:
        each = [one.alone / two.alone for one, two in pairs if one.alone and two.alone]
        found.append(Ratio("alone on its machine", memory, whole, each or [whole]))
    used = [one.cpu[who] / two.cpu[who] for one, two in pairs]
    return [*found, Ratio(CPU, cpu, mine.cpu.mean / its.cpu.mean, used)]


def _lost_flights(figures: Figures, mission: str, speed: float) -> str:
    """Flights that were not done, if any: how many of how many, by approach."""
    found = [
        f"{len(one.again)} of {len(one.again) + len(one.flights)} {title}"
        for approach, title in ((BDI, "of the agents"), (IMPERATIVE, "of the programs"))
        if (one := figures.of(mission, speed, approach)).again
    ]
    return f"; flights lost: {', '.join(found)}" if found else ""


def _why(bdi: Usage, other: Usage, who: str, missed: list[Ratio]) -> str:
    mine, its = bdi.row(who), other.row(who)
    parts = []
    if any(one.what == CPU for one in missed):
        parts.append(f"{mine.cpu.mean:.2f} beside {its.cpu.mean:.2f} % of a core. {_CPU}")
    if any(one.what != CPU for one in missed):
        parts.append(f"{mine.rss.mean:.1f} beside {its.rss.mean:.1f} MB (RSS). {_MEMORY}")
    return "; ".join(parts)


def alone(bdi: Usage, other: Usage) -> float | None:
    """Return the ratio of what the boards would hold alone; None where the kernel does not report it."""
    return sum(bdi.alone.values()) / sum(other.alone.values()) if bdi.alone and other.alone else None


OURS: Final = {BDI: "AgentSpeak", IMPERATIVE: "Python"}
THEIRS: Final = {BDI: "Jason", IMPERATIVE: "Python"}
BOARDS: Final = {"pi1": "Scout", "pi2": "Rescuer 1", "pi3": "Rescuer 2", ALL: ALL}
"""The paper's names of the boards of search and rescue."""
PI_CORES: Final = 4
"""The paper's per cents of processor are of all cores of its board."""


def in_short(figures: Figures) -> list[str]:
    """Return rows for a table of Argosy beside others: the cost of the BDI approach to a board, at speed 1."""
    theirs = {title.removeprefix("the paper, "): ratios for title, ratios, _ in paper_ratios()}
    rows = []
    for mission, speed in figures.missions():
        if speed == 1:
            mine, its = (figures.of(mission, speed, approach).row(BOARD) for approach in OURS)
            cpu, memory = theirs[TITLES[mission]]
            one = ONE_PAIR if len(figures.pairs(mission, speed)) == 1 else ""
            what = f"agents instead of imperative programs, {TITLES[mission]}: a board's processor and memory"
            ours = f"{mine.cpu.mean / its.cpu.mean:.2f}x, {mine.rss.mean / its.rss.mean:.2f}x{one}"
            source = "([measured](docs/measurements/benchmarks.md#processor-and-memory))"
            rows.append(row(what, ours, f"Jason in the paper {cpu:.2f}x, {memory:.2f}x {source}"))
    return rows


def in_comparison(figures: Figures) -> list[str]:
    """Return the row of the table of boards' memory in docs/measurements/benchmarks.md."""
    rows = []
    for one in figures.usages:
        if (one.mission, one.speed, one.approach) == (SINGLE.mission, 1.0, IMPERATIVE):
            held = f"{one.row(BOARD).pss.mean:.0f} MB (PSS)"
            if one.alone:
                held += f"; {sum(one.alone.values()):.0f} MB if nothing else on the machine shares their libraries"
            what = "Argosy with an imperative program in agentd's place, in flight"
            rows.append(row(what, held, "a computer", "[processor and memory](#processor-and-memory)"))
    return rows


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    lines = [origin.line(), ""]
    for mission, title in TITLES.items():
        if any(one.mission == mission for one in figures.usages):
            lines += [f"### {'Table 3' if mission == SINGLE.mission else 'Table 5'}: {title}", ""]
            lines += [
                *_paper_table(figures, mission),
                "",
                *_daemons(figures, mission),
                "",
                _again(figures, mission),
                "",
            ]
    return {"paper-usage": "\n".join([*lines, "### The two approaches", "", *_approaches(figures)])}


_PAPER_HEAD: Final = (
    "| board | approach | speed | CPU, % of a core: mean | std | max | memory, % of a Pi 3: mean | std | max | "
    "RSS, MB | PSS, MB | alone, MB |"
)
_DAEMONS_HEAD: Final = (
    "| process | approach | speed | CPU, % of a core: mean | std | max | RSS, MB: mean | std | max | PSS, MB |"
)


def _paper_table(figures: Figures, mission: str) -> list[str]:
    """Return the paper's rows, and ours: a board's processes together."""
    rows = []
    for board in _boards(figures, mission):
        name = "the only one" if mission == SINGLE.mission else BOARDS[board]
        for approach, theirs in THEIRS.items():
            paper = peers.TABLE_3[theirs] if mission == SINGLE.mission else peers.TABLE_5[theirs][BOARDS[board]]
            cpu = peers.Usage(*(PI_CORES * one for one in (paper.cpu.mean, paper.cpu.std, paper.cpu.max)))
            rows.append(row(name, f"the paper's {theirs}", "unknown", _cells(cpu), _cells(paper.memory), "", "", ""))
            for one in _usages(figures, mission, approach):
                used = one.row(BOARD, board)
                percent = MeanStdMax(
                    *(100 * value / peers.PI_MB for value in (used.rss.mean, used.rss.std, used.rss.max))
                )
                held = [value for where, value in one.alone.items() if board in (ALL, where)]
                alone_mb = f"{sum(held) / len(held):.1f}" if held else "unknown"
                memory = (_cells(percent), f"{used.rss.mean:.1f}", f"{used.pss.mean:.1f}", alone_mb)
                rows.append(row(name, f"**{OURS[one.approach]}**", f"{one.speed:g}", _cells(used.cpu), *memory))
    return table(_PAPER_HEAD, rows)


def _daemons(figures: Figures, mission: str) -> list[str]:
    rows = []
    for who in dict.fromkeys(ROLES.values()):
        for approach, title in OURS.items():
            for one in _usages(figures, mission, approach):
                used = one.row(who)
                memory = _cells(used.rss), f"{used.pss.mean:.1f}"
                rows.append(row(who, title, f"{one.speed:g}", _cells(used.cpu), *memory))
    return table(_DAEMONS_HEAD, rows)


def _again(figures: Figures, mission: str) -> str:
    """Return which flights were flown again."""
    again = []
    for speed in (speed for flown, speed in figures.missions() if flown == mission):
        for approach, title in OURS.items():
            one = figures.of(mission, speed, approach)
            whys = f" ({'; '.join(one.again)})" if one.again else ""
            again.append(f"{title} at speed {speed:g} {len(one.again)} of {len(one.again) + len(one.flights)}{whys}")
    return f"Flights that were not done and were flown again: {', '.join(again)}."


def _approaches(figures: Figures) -> list[str]:
    rows = [row(title, f"{board[0]:.2f}x", f"{board[1]:.2f}x", "", "", agent) for title, board, agent in paper_ratios()]
    for mission, speed in figures.missions():
        bdi, other = figures.of(mission, speed, BDI), figures.of(mission, speed, IMPERATIVE)
        cells = {
            who: [
                f"{getattr(bdi.row(who), what).mean / getattr(other.row(who), what).mean:.2f}x"
                for what in ("cpu", "rss", "pss")
            ]
            for who in (BOARD, AGENT)
        }
        held = alone(bdi, other)
        whole = "unknown" if held is None else f"{held:.2f}x"
        rows.append(row(f"{TITLES[mission]}, speed {speed:g}", *cells[BOARD], whole, *cells[AGENT]))
    return table(
        "| AgentSpeak beside Python | board: CPU | RSS | PSS | alone | agent's process: CPU | RSS | PSS |", rows
    )


def paper_ratios() -> list[tuple[str, tuple[float, float], str]]:
    """By mission: a board's CPU and memory in Jason beside Python; the agent's process from its own measurements."""
    jason, python = peers.PROCESSES["Jason agent"], peers.PROCESSES["Python agent"]
    agent = f"{sum(jason.cpu) / sum(python.cpu):.1f}x | {sum(jason.memory) / sum(python.memory):.1f}x | "
    found = []
    for title, by in ((SINGLE.title, peers.TABLE_3), (RESCUE.title, {k: v[ALL] for k, v in peers.TABLE_5.items()})):
        mine, its = by["Jason"], by["Python"]
        ratios = mine.cpu.mean / its.cpu.mean, mine.memory.mean / its.memory.mean
        found.append((f"the paper, {title}", ratios, agent))
    return found


def _usages(figures: Figures, mission: str, approach: str) -> list[Usage]:
    return [one for one in figures.usages if (one.mission, one.approach) == (mission, approach)]


def _boards(figures: Figures, mission: str) -> list[str]:
    if mission == SINGLE.mission:
        return [ALL]
    boards = [used.board for one in figures.usages if one.mission == mission for used in one.rows]
    return [*(board for board in dict.fromkeys(boards) if board != ALL), ALL]


def _cells(spread: MeanStdMax | peers.Usage) -> str:
    return f"{spread.mean:.2f} | {spread.std:.2f} | {spread.max:.2f}"
