"""The paper's first mission with its board kept within the limits of a small one.

All daemons of the board are in one control group; the simulator, on another computer in the paper (section 5.1), is
outside. Some flights are flown side by side; those without limits are the first, and show what that costs.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, wait
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

from argosy.processes.process_table import plan
from benchmarks.flights import SINGLE, Flight, setup_in, start_all, with_one_process
from benchmarks.health import listening
from benchmarks.parts import tell
from benchmarks.processes import BenchmarkFailed, Watched, alone
from benchmarks.results import Origin, busy_seconds
from benchmarks.serving import READY
from benchmarks.small_boards.control_groups import ControlGroup, Limits, limited
from benchmarks.small_boards.page import (
    BOARDS,
    FORMS,
    ONE,
    SYSTEM,
    THREE,
    Figures,
    Flown,
    Wanted,
    block,
    goals,
    in_short,
)

SPEED: Final = 1.0
START: Final = 150.0
"""Wall seconds that a board may take until all its daemons are there."""
FLIGHT: Final = 150.0
"""Simulated seconds that the mission may take then: more than one and a half times what it takes."""
LOOK_EVERY: Final = 4.0
SETTLED: Final = 3.0
"""Wall seconds after which a daemon tells no more of how late its loop was in its start."""


def stood(form: str) -> Flown:
    """Start a board without limits, and see what it holds on the ground."""
    with limited(Limits()) as group, ExitStack() as stack:
        tell(f"{form}, on the ground")
        flight = _started(stack, form, group, SPEED)
        time.sleep(SETTLED)
        elsewhere = _elsewhere(_ours(flight), group)
        return Flown("", form, None, None, 1, group.kind, charged=group.usage().peak, elsewhere=elsewhere)


def fly(wanted: Wanted) -> Flown:
    """Fly the mission once."""
    limits = wanted.limits
    with limited(limits) as group, ExitStack() as stack:
        flown = Flown(wanted.board, wanted.form, limits.memory, limits.share, limits.cores, group.kind)
        flight = None
        try:
            flight = _started(stack, wanted.form, group, wanted.speed)
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
            flight.watched[-1][1].says(words, START)
    flight.until_up(START)
    return flight


def _why(failed: BenchmarkFailed, flight: Flight | None) -> str:
    """Return the reason of a failure: the agent's own, if it has told one."""
    watched = flight.watched if flight is not None else []
    said = [line for _, one in watched for _, line in one.said if SINGLE.given_up in line]
    if said:
        return said[0].partition(f"{SINGLE.given_up}: ")[2]
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
        timed_out=sum("timed_out" in line for one in ours for _, line in one.said),
    )


def _ours(flight: Flight) -> list[Watched]:
    return [watched for process, watched in flight.watched if process.kind.measured]


def _elsewhere(ours: Sequence[Watched], group: ControlGroup) -> float:
    """Return the MB that processes hold and that are not charged to them: 0 where the kernel does not tell."""
    try:
        held = alone([one.process.pid for one in ours])
    except OSError:  # one has ended
        return 0.0
    return max(0.0, (held or 0.0) - group.charged())


__all__ = ["Figures", "blocks", "goals", "in_short", "measure"]

LATE: Final = 0.1
"""Wall seconds: when a daemon's loop without limits was later than this, the machine was too busy for any row."""
QUICK_SPEED: Final = 5.0
APART: Final = 2.5
"""Wall seconds between the starts of two flights."""


def measure(quick: bool) -> Figures:
    """Fly everything; a flight that a limit ends is a figure. Raises BenchmarkFailed when one without limits fails."""
    speed = QUICK_SPEED if quick else SPEED
    found = {form: stood(form) for form in FORMS}
    boards = [
        Wanted(form, replace(board.limits, memory=board.memory - SYSTEM - found[form].elsewhere), speed, board.title)
        for board in BOARDS
        for form in FORMS
    ]
    if quick:  # few, and with so much of a core that this speed is kept up
        boards = [replace(one, limits=replace(one.limits, share=0.9)) for one in boards[:2]]
    begun, busy = time.monotonic(), busy_seconds()
    fresh = _side_by_side(
        [Wanted(form, Limits(), speed, "no limits") for form in FORMS]
    )  # what others are held against
    small = _side_by_side(boards)
    figures = Figures(small, fresh, len(boards), (busy_seconds() - busy) / (time.monotonic() - begun))
    if failed := [one for one in fresh if not one.completed]:
        raise BenchmarkFailed(f"small boards: {failed[0].form}, without limits: {failed[0].why}")
    if not quick and (late := [one for one in fresh if one.lag > LATE]):
        raise BenchmarkFailed(
            f"small boards: {late[0].form}, without limits, was late by {late[0].lag:.2f} s: the machine is too busy"
        )
    return figures


def _side_by_side(flights: Sequence[Wanted]) -> list[Flown]:
    """Fly some at once, each from a process of its own, so that they share nothing but the machine."""
    tell(f"{len(flights)} flights, side by side")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(len(flights), context, max_tasks_per_child=1) as pool:
        flown = []
        for wanted in flights:
            flown.append(pool.submit(fly, wanted))
            time.sleep(APART)
        return [one.result() for one in flown]


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of docs/measurements/benchmarks.md."""
    return {"small-boards": block(origin, figures)}
