"""Part `small-boards`: the paper's first mission with its board within the limits of a small one.

All daemons of the board are in one control group; the simulator, on another computer in the paper (section 5.1), is
outside. The flights without limits are the first, and show that the machine is quiet enough.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from argosy.processes.process_table import plan
from benchmarks import peers
from benchmarks.flights import SINGLE, Flight, setup_in, start_all, with_one_process
from benchmarks.health import listening
from benchmarks.measurements.control_groups import ControlGroup, Limits, limited
from benchmarks.parts import Goal, progress, row, table
from benchmarks.processes import BenchmarkFailed, Watched, alone
from benchmarks.results import Origin
from benchmarks.serving import READY

SYSTEM: Final = 128.0
"""MB of a board's memory that are left to its system, which is a Debian without a desktop."""

OUR_DMIPS: Final = 40_000.0
"""What one core of this machine is taken to do: 10 DMIPS per MHz at 4 GHz. The more is assumed, the less a board is
given. (A Core i7-5960X does 238,310 by 8 cores at 3.0 GHz, which is 9.9 per MHz:
http://scottsoapbox.com/2015/08/15/how-far-weve-come-40-years-of-processing-power)"""


@dataclass(frozen=True)
class Board:
    """A board whose limits are kept."""

    title: str
    memory: float
    """MB."""
    cores: int
    clock: float
    """MHz."""
    dmips_per_mhz: float
    """As ARM gives it for the core."""
    core: str

    @property
    def share(self) -> float:
        """What one of its cores is of one of this machine's."""
        return self.clock * self.dmips_per_mhz / OUR_DMIPS

    @property
    def limits(self) -> Limits:
        return Limits(self.memory - SYSTEM, self.share, self.cores)


BEAGLEBONE: Final = Board("BeagleBone Black", peers.BEAGLEBONE_MB, 1, 1000, 2.0, "Cortex-A8")
PI_3: Final = Board("Raspberry Pi 3", peers.PI_MB, 4, 1200, 2.3, "Cortex-A53")
BOARDS: Final = (BEAGLEBONE, PI_3)


THREE, ONE = "three daemons", "`argosy board`"
FORMS: Final = (THREE, ONE)


@dataclass(frozen=True)
class Flown:
    """One flight, and what the board's daemons used for it."""

    board: str
    form: str
    memory: float | None
    """MB that they were allowed."""
    share: float | None
    """Of a core of this machine, for each of the board's cores."""
    cores: int
    kept_by: str
    completed: bool = False
    why: str = ""
    """For one that was not completed."""
    ready: float = 0.0
    """Seconds from the start until all daemons were there."""
    mission: float = 0.0
    """Seconds from then until the mission was done."""
    charged: float = 0.0
    """MB that counted against the limit, at most."""
    elsewhere: float = 0.0
    """MB that they held besides: pages of libraries that were charged to others, who had read them before."""
    cpu: float = 0.0
    """Per cent of a core in flight."""
    throttled: float = 0.0
    """Seconds in which they were held back."""
    lag: float = 0.0
    """Seconds by which a daemon's loop was late in flight, at worst."""
    timed_out: int = 0
    """Actions that were not done within their deadline."""

    @property
    def held(self) -> float:
        """MB in all."""
        return self.charged + self.elsewhere


@dataclass(frozen=True)
class Figures:
    """What was flown."""

    boards: list[Flown]
    """With the limits of boards."""
    free: list[Flown]
    """Without limits, one of each form."""


SPEED: Final = 1.0
START: Final = 150.0
"""Wall seconds that a board may take until all its daemons are there."""
FLIGHT: Final = 150.0
"""Simulated seconds that the mission may take then: more than one and a half times what it takes."""
LOOK_EVERY: Final = 4.0
SETTLED: Final = 3.0
"""Wall seconds after which health no longer includes the lag of the start."""
LATE: Final = 0.1
"""Wall seconds: when a daemon's loop without limits was later than this, the machine was too busy for any row."""
QUICK_SPEED: Final = 5.0


def fly(board: str, form: str, limits: Limits, speed: float) -> Flown:
    """Fly the mission once within the limits of a board."""
    progress(f"{board}, {form}")
    with limited(limits) as group, ExitStack() as stack:
        flown = Flown(board, form, limits.memory, limits.share, limits.cores, group.kind)
        flight = None
        try:
            flight = _started(stack, form, group, speed)
            flown = replace(flown, ready=flight.up - flight.begun)
            return _in_flight(stack, flight, group, flown)
        except BenchmarkFailed as failed:
            usage = group.usage()
            why = "out of memory" if usage.killed else _why(failed, flight)
            return replace(flown, why=why, charged=usage.peak, throttled=usage.throttled)


def _started(stack: ExitStack, form: str, group: ControlGroup, speed: float) -> Flight:
    """Start the vehicle's simulator, then the board's daemons in the control group, and wait until they are there."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="argosy-bench-")))
    setup = setup_in(folder, SINGLE.mission, speed)
    planned = plan(setup) if form == THREE else with_one_process(setup, "local", plan(setup))
    flight = Flight(SINGLE, "agentspeak", setup, {})
    start_all(stack, [one for one in planned if not one.kind.measured], flight.watched)
    flight.until_up()
    flight.begun = time.monotonic()  # the board is switched on
    start_all(stack, [one for one in planned if one.kind.measured], flight.watched, group.command, START)
    if form == ONE:
        for words in (READY["bridged"], READY["agentd"]):
            flight.watched[-1][1].wait_for(words, START)
    flight.until_up(START)
    return flight


def _why(failed: BenchmarkFailed, flight: Flight | None) -> str:
    """Return the reason of a failure: the agent's own, if it has printed one."""
    watched = flight.watched if flight is not None else []
    given_up = [line for _, one in watched for _, line in one.output if SINGLE.given_up in line]
    if given_up:
        return given_up[0].partition(f"{SINGLE.given_up}: ")[2]
    return str(failed).partition("\n")[0].removesuffix("; last:")


def _in_flight(stack: ExitStack, flight: Flight, group: ControlGroup, flown: Flown) -> Flown:
    """Wait for the end of the mission, and look at what is used meanwhile."""
    ours = _ours(flight)
    records = stack.enter_context(listening(flight.setup.router, flight.setup.mission.fleet))
    used, begun = sum(one.cpu() for one in ours), time.monotonic()
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(flight.until_done, flight.up - flight.begun + FLIGHT / flight.setup.speed)
        elsewhere: list[float] = []
        while wait([done], LOOK_EVERY).not_done:
            elsewhere.append(_elsewhere(ours, group))
        done.result()
    ended = time.monotonic()
    usage = group.usage()
    return replace(
        flown,
        completed=True,
        mission=flight.over - flight.up,
        charged=usage.peak,
        elsewhere=max(elsewhere, default=0.0),
        cpu=100 * (sum(one.cpu() for one in ours) - used) / (ended - begun),
        throttled=usage.throttled,
        lag=max(records.lag(flight.up + SETTLED, ended).values(), default=0.0),
        timed_out=sum("timed_out" in line for one in ours for _, line in one.output),
    )


def _ours(flight: Flight) -> list[Watched]:
    return [watched for process, watched in flight.watched if process.kind.measured]


def _elsewhere(ours: Sequence[Watched], group: ControlGroup) -> float:
    """Return the MB that processes hold and that are not charged to them: 0 where the kernel does not report it."""
    try:
        held = alone([one.process.pid for one in ours])
    except OSError:  # one has ended
        return 0.0
    return max(0.0, (held or 0.0) - group.charged())


def measure(quick: bool) -> Figures:
    """Fly everything; a flight that a limit ends is a figure. Raises BenchmarkFailed when one without limits fails."""
    speed = QUICK_SPEED if quick else SPEED
    free = {form: fly("no limits", form, Limits(), speed) for form in FORMS}
    for one in free.values():
        if not one.completed:
            raise BenchmarkFailed(f"small boards: {one.form}, without limits: {one.why}")
        if not quick and one.lag > LATE:
            raise BenchmarkFailed(f"small boards: {one.form} was late by {one.lag:.2f} s: the machine is too busy")
    small = []
    for board in BOARDS[:1] if quick else BOARDS:
        for form in FORMS:
            limits = replace(board.limits, memory=board.memory - SYSTEM - free[form].elsewhere)
            # with so much of a core the speed of a try is kept up
            small.append(fly(board.title, form, replace(limits, share=0.9) if quick else limits, speed))
    return Figures(small, list(free.values()))


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of docs/measurements/benchmarks.md."""
    parts = [
        origin.line(),
        "The paper's first mission (section 5.1) at speed 1 with all daemons of its board held within the limits of a "
        f"small one by {figures.free[0].kept_by}; the simulator, on another computer in the paper, is outside. **No "
        "such board was at hand**: memory is the board's own, and what share of a core here equals one of its "
        "cores is derived from published figures (DMIPS per MHz of its core) and an assumption: that a core here does "
        f"{OUR_DMIPS:,.0f} DMIPS, 10 per MHz at 4 GHz. On a slower machine than that a board is given less than it "
        "has.",
        "\n".join(_given()),
        f"Daemons without limits were late by {max(one.lag for one in figures.free):.2f} s at worst. Only memory and "
        "the share of a core are limited. **Not modelled**: a small board's caches and memory bandwidth, its SD card, "
        "a processor of 32 bits with a build of Python and libraries of its own.",
        "\n".join(_flights([*figures.free, *figures.boards])),
        "*Ready*: seconds from the start until all daemons were there. *Held*: at most, and each page once, as if "
        "nobody else on the machine had read the same libraries. *Held back*: seconds for which processes that had "
        "work to do had used up their share. *Late*: by how much a daemon's loop was behind at worst in flight. In the "
        f"paper, on a BeagleBone Black, the agents in Jason were {peers.BEAGLEBONE}; all of their nodes together hold "
        f"{peers.mb(peers.JASON_BOARD[0]):.0f} to {peers.mb(peers.JASON_BOARD[1]):.0f} MB.",
    ]
    return {"small-boards": "\n\n".join(parts), "board": "\n\n".join([origin.line(), _both_forms(figures)])}


def _both_forms(figures: Figures) -> str:
    """Return the table of docs/guides/boards.md: what a board needs in flight without limits."""
    rows = [f"| {one.form} | {one.ready:.1f} | {one.held:.0f} | {one.cpu:.1f} |" for one in figures.free]
    return "\n".join(table("| the single-UAV mission | ready, s | memory, MB | processor, % of a core |", rows))


def in_comparison(figures: Figures) -> list[str]:
    """Return the rows of the table of boards' memory in docs/measurements/benchmarks.md."""
    return [
        f"| Argosy, {one.form}, in flight | {one.held:.0f} MB if nothing else on the machine shares their libraries "
        "| a computer | [small boards](#small-boards) |"
        for one in figures.free
    ]


def _given() -> list[str]:
    rows = []
    for board in BOARDS:
        memory = (f"{value:.0f} MB" for value in (board.memory, SYSTEM, board.memory - SYSTEM))
        cores = f"{board.cores} x {board.clock:.0f} MHz {board.core}, {board.dmips_per_mhz:g} DMIPS per MHz"
        rows.append(row(board.title, *memory, cores, f"{board.share:.1%}"))
    return table(
        "| board | memory | left to its system | left to the daemons | cores | a core of it, of one here |", rows
    )


def _flights(flights: Sequence[Flown]) -> list[str]:
    head = (
        "| limits of | | mission | ready, s | mission, s | held, MB | processor, % of a core | held back, s | late, s "
        "| actions timed out |"
    )
    rows = []
    for one in flights:
        tenths = (f"{value:.1f}" for value in (one.cpu, one.throttled))
        used = f"{one.ready:.1f}", f"{one.mission:.1f}", f"{one.held:.0f}", *tenths, f"{one.lag:.2f}", one.timed_out
        cells = ("completed", *used) if one.completed else (f"**{one.why}**", *[""] * len(used))
        rows.append(row(one.board, one.form, *cells))
    return table(head, rows)


def given_memory(figures: Figures, one: Flown) -> float:
    """Return the MB that a flight was given, with the pages that were not charged to it."""
    free = next(flown for flown in figures.free if flown.form == one.form)
    return (one.memory or 0.0) + free.elsewhere


def goals(figures: Figures) -> list[Goal]:
    """Return the goals: the mission is completed on each board, in both forms."""
    found = []
    for board in dict.fromkeys(one.board for one in figures.boards):
        flights = [one for one in figures.boards if one.board == board]
        words = [f"{one.form}: {f'completed, {one.held:.0f} MB' if one.completed else one.why}" for one in flights]
        met = all(one.completed for one in flights)
        why = "" if met else _limit(flights)
        title = f"single-UAV mission within the limits of a {board}"
        found.append(Goal(title, "completed", "; ".join(words), met, why))
    return found


def _limit(flights: Sequence[Flown]) -> str:
    """Return why a mission was not completed, as far as it is known."""
    lost = [one for one in flights if not one.completed]
    use = "; ".join(
        f"{one.form} held {one.held:.0f} MB at most and was held back for {one.throttled:.1f} s" for one in lost
    )
    return f"{use}; which of the limits it is, is not known"


def in_short(figures: Figures) -> list[str]:
    """Return the row of the README's table: what became of the mission within the limits of a BeagleBone Black."""
    title = BEAGLEBONE.title
    flights = [one for one in figures.boards if one.board == title]
    completed = all(one.completed for one in flights)
    memory = max(given_memory(figures, one) for one in flights)
    share = flights[0].share
    given = f"{memory:.0f} MB" + ("" if share is None else f" and {share:.0%} of a core here")
    return [
        f"| the paper's first mission within the limits of a {title} ({given}; no such board was at hand) | "
        f"{'completed' if completed else 'not completed'} | in the paper {peers.BEAGLEBONE} "
        "([measured](docs/measurements/benchmarks.md#small-boards)) |"
    ]
