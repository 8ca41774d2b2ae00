"""The paper's first mission with its board kept within the limits of a small one, and how little is still enough.

All daemons of the board are in one cage (`cages`); the simulator, on another computer in the paper (section 5.1), is
outside. Flights of one table are flown side by side.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from argosy.processes import plan
from benchmarks.flights import READY, SINGLE, Flight, setup_in, with_one_process
from benchmarks.held import alone
from benchmarks.parts import Goal, tell
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import Origin
from benchmarks.scale.health import Records, listening
from benchmarks.small_boards import page as small_boards_page
from benchmarks.small_boards.cages import caged
from benchmarks.small_boards.limits import Cage, Limits
from benchmarks.watched import Watched, watched_command

SPEED: Final = 1.0
QUICK_SPEED: Final = 5.0
START: Final = 150.0
"""Wall seconds that a board may take until all its daemons are there."""
FLIGHT: Final = 150.0
"""Simulated seconds that the mission may take then: more than one and a half times what it takes."""
LOOK_EVERY: Final = 4.0
SETTLED: Final = 3.0
"""Wall seconds after which a daemon tells no more of how late its loop was in its start."""
APART: Final = 2.5
"""Wall seconds between the starts of two flights."""
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


BEAGLEBONE: Final = Board("BeagleBone Black", 512, 1, 1000, 2.0, "Cortex-A8")
PI_3: Final = Board("Raspberry Pi 3", 1024, 4, 1200, 2.3, "Cortex-A53")
BOARDS: Final = (BEAGLEBONE, PI_3)

THREE, ONE = "three daemons", "`argosy board`"
FORMS: Final = (THREE, ONE)
SHARES: Final = {THREE: (0.015, 0.02, 0.03), ONE: (0.01, 0.015, 0.02, 0.03)}
"""Of one core of this machine for the whole board."""
PARTS_OF_MEMORY: Final = (0.95, 1.0, 1.05)
"""Of what the board holds when its daemons are there."""


@dataclass(frozen=True)
class Wanted:
    """A flight to be flown."""

    form: str
    limits: Limits
    speed: float
    board: str = ""


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

    shares: list[Flown]
    """With shares of one core, and as much memory as there is."""
    boards: list[Flown]
    """With the limits of boards."""
    memory: list[Flown]
    """With little memory, and all that there is of the processor."""
    free: list[Flown]
    """Without limits, one of each form."""


def measure(quick: bool) -> Figures:
    """Fly everything; a flight that a limit ends is a figure. Raises BenchmarkFailed when one without limits fails."""
    speed = QUICK_SPEED if quick else SPEED
    found = {form: stood(form) for form in FORMS}
    shares = [Wanted(form, Limits(share=share), speed) for form in FORMS for share in SHARES[form]]
    boards = [
        Wanted(form, replace(board.limits, memory=board.memory - SYSTEM - found[form].elsewhere), speed, board.title)
        for board in BOARDS
        for form in FORMS
    ]
    memory = [
        Wanted(form, Limits(part * found[form].held - found[form].elsewhere), speed)
        for form in FORMS
        for part in PARTS_OF_MEMORY
    ]
    if quick:  # few, and with so much of a core that this speed is kept up
        boards = [replace(one, limits=replace(one.limits, share=0.9)) for one in boards[:2]]
        memory, shares = memory[2:3], [Wanted(ONE, Limits(share=0.9), speed)]
    free = [Wanted(form, Limits(), speed, "no limits") for form in FORMS]
    groups = (shares, boards, memory, free)  # the slowest start first
    flown = iter(_side_by_side([one for group in groups for one in group]))
    figures = Figures(*([next(flown) for _ in group] for group in groups))
    if failed := [one for one in figures.free if not one.completed]:
        raise BenchmarkFailed(f"small boards: {failed[0].form}, without limits: {failed[0].why}")
    return figures


def stood(form: str) -> Flown:
    """Start a board without limits, and see what it holds on the ground."""
    with caged(Limits()) as cage, ExitStack() as stack:
        tell(f"{form}, on the ground")
        flight = _started(stack, form, cage, SPEED)
        time.sleep(SETTLED)
        elsewhere = _elsewhere(_ours(flight), cage)
        return Flown("", form, None, None, 1, cage.kind, charged=cage.usage().peak, elsewhere=elsewhere)


def _side_by_side(flights: Sequence[Wanted]) -> list[Flown]:
    """Fly all at once, each from a process of its own, so that they share nothing but the machine."""
    tell(f"{len(flights)} flights side by side")
    with ProcessPoolExecutor(len(flights), multiprocessing.get_context("spawn")) as pool:
        flown = []
        for wanted in flights:
            flown.append(pool.submit(fly, wanted))
            time.sleep(APART)
        return [one.result() for one in flown]


def fly(wanted: Wanted) -> Flown:
    """Fly the mission once."""
    limits = wanted.limits
    with caged(limits) as cage, ExitStack() as stack:
        flown = Flown(wanted.board, wanted.form, limits.memory, limits.share, limits.cores, cage.kind)
        flight = None
        try:
            flight = _started(stack, wanted.form, cage, wanted.speed)
            flown = replace(flown, ready=flight.up - flight.begun)
            return _in_flight(stack, flight, cage, flown)
        except BenchmarkFailed as failed:
            usage = cage.usage()
            why = "out of memory" if usage.killed else _why(failed, flight)
            return replace(flown, why=why, charged=usage.peak, throttled=usage.throttled)


def _started(stack: ExitStack, form: str, cage: Cage, speed: float) -> Flight:
    """Start the vehicle's simulator, then the board's daemons in the cage, and wait until they are there."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="argosy-bench-")))
    setup = setup_in(folder, SINGLE.mission, speed)
    planned = plan(setup) if form == THREE else with_one_process(setup, "local", plan(setup))
    flight = Flight(SINGLE, "agentspeak", setup, {})
    for process in sorted(planned, key=lambda process: process.kind.measured):
        ours = process.kind.measured
        if process.kind.name == "commd":
            flight.begun = time.monotonic()  # the board is switched on
        command = cage.command(list(process.argv)) if ours else list(process.argv)
        watched = stack.enter_context(watched_command(process.name, command))
        flight.watched.append((process, watched))
        if process.kind.name in {"commd", "simulator"}:
            _until(flight, watched, READY[process.kind.name])
    for process, watched in flight.watched:
        one_process = form == ONE and process.kind.measured
        for words in _ALL_READY if one_process else (READY[process.kind.name],):
            _until(flight, watched, words)
    flight.up = time.monotonic()
    return flight


def _why(failed: BenchmarkFailed, flight: Flight | None) -> str:
    """Return the reason of a failure: the agent's own, if it has told one."""
    watched = flight.watched if flight is not None else []
    said = [line for _, one in watched for _, line in one.said if SINGLE.given_up in line]
    if said:
        return said[0].partition(f"{SINGLE.given_up}: ")[2]
    return str(failed).partition("\n")[0].removesuffix("; last:")


_ALL_READY: Final = (READY["bridged"], READY["agentd"])


def _until(flight: Flight, watched: Watched, words: str) -> None:
    while not any(words in line for _, line in watched.said):
        for _, one in flight.watched:
            if (code := one.process.poll()) is not None:
                last = "\n".join(line for _, line in one.said[-3:])
                raise BenchmarkFailed(f"{one.name} ended with exit code {code} before all were there; last:\n{last}")
        if time.monotonic() > flight.begun + START:
            raise BenchmarkFailed(f"{watched.name} was not there after {START:g} s")
        time.sleep(0.05)


def _in_flight(stack: ExitStack, flight: Flight, cage: Cage, flown: Flown) -> Flown:
    """Wait for the end of the mission, and look at what is used meanwhile."""
    ours = _ours(flight)
    records = stack.enter_context(listening(flight.setup.router, flight.setup.mission.fleet))
    used, begun = sum(one.cpu() for one in ours), time.monotonic()
    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(flight.until_done, flight.up - flight.begun + FLIGHT / flight.setup.speed)
        elsewhere: list[float] = []
        while not done.done():
            time.sleep(LOOK_EVERY)
            elsewhere.append(_elsewhere(ours, cage))
        done.result()
    ended = time.monotonic()
    usage = cage.usage()
    return replace(
        flown,
        completed=True,
        mission=flight.over - flight.up,
        charged=usage.peak,
        elsewhere=max(elsewhere),
        cpu=100 * (sum(one.cpu() for one in ours) - used) / (ended - begun),
        throttled=usage.throttled,
        lag=_lag(records, flight.up + SETTLED, ended),
        timed_out=sum("timed_out" in line for one in ours for _, line in one.said),
    )


def _ours(flight: Flight) -> list[Watched]:
    return [watched for process, watched in flight.watched if process.kind.measured]


def _elsewhere(ours: Sequence[Watched], cage: Cage) -> float:
    """Return the MB that processes hold and that are not charged to them: 0 where the kernel does not tell."""
    try:
        held = alone([one.process.pid for one in ours])
    except OSError:  # one has ended
        return 0.0
    return max(0.0, (held or 0.0) - cage.charged())


def _lag(records: Records, begun: float, ended: float) -> float:
    return max((health.lag for told in records.between(begun, ended).values() for _, health in told), default=0.0)


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of docs/benchmarks.md."""
    return {"small-boards": small_boards_page.block(origin, figures, BOARDS, SYSTEM, OUR_DMIPS)}


def pictures(figures: Figures) -> dict[str, str]:
    """Return its picture."""
    limits = {board.title: board.memory - SYSTEM for board in BOARDS}
    return {"small-boards": small_boards_page.picture(figures, limits)}


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked: the mission is completed on each board."""
    return small_boards_page.goals(figures)


def in_short(figures: Figures) -> list[str]:
    """Return the row of the README's table."""
    return small_boards_page.in_short(figures, BEAGLEBONE.title)
