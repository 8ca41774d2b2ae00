"""The paper's first mission with its board kept within the limits of a small one, and how little is still enough.

All daemons of the board are in one cage (`cages`); the simulator, on another computer in the paper (section 5.1), is
outside. Some flights are flown side by side; those without limits are the first, and show what that costs.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from typing import Final

import psutil

from benchmarks.parts import Goal, tell
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import Origin
from benchmarks.small_boards import page as small_boards_page
from benchmarks.small_boards.boards import BEAGLEBONE, BOARDS, OUR_DMIPS, SYSTEM
from benchmarks.small_boards.figures import FORMS, ONE, THREE, Figures, Flown, Wanted
from benchmarks.small_boards.flight import SPEED, fly, stood
from benchmarks.small_boards.limits import Limits

__all__ = ["Figures", "blocks", "goals", "in_short", "measure", "pictures"]

SIDE_BY_SIDE: Final = 6
"""Flights at once, at most: 19 of them would wait for one another on two cores, and not for their limits."""
LATE: Final = 0.1
"""Wall seconds: when a daemon's loop without limits was later than this, the machine was too busy for any row."""
QUICK_SPEED: Final = 5.0
APART: Final = 2.5
"""Wall seconds between the starts of two flights."""
SHARES: Final = {THREE: (0.015, 0.02, 0.03), ONE: (0.01, 0.015, 0.02, 0.03)}
"""Of one core of this machine for the whole board."""
PARTS_OF_MEMORY: Final = (0.95, 1.0, 1.05)
"""Of what the board holds when its daemons are there."""


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
    begun, busy = time.monotonic(), _busy()
    fresh = _side_by_side(free)  # apart: they are what the others are held against
    flown = iter(_side_by_side([one for group in (shares, boards, memory) for one in group]))
    slow, small, tight = ([next(flown) for _ in group] for group in (shares, boards, memory))
    cores = (_busy() - busy) / (time.monotonic() - begun)
    figures = Figures(slow, small, tight, fresh, SIDE_BY_SIDE, cores)
    if failed := [one for one in fresh if not one.completed]:
        raise BenchmarkFailed(f"small boards: {failed[0].form}, without limits: {failed[0].why}")
    if not quick and (late := [one for one in fresh if one.lag > LATE]):
        raise BenchmarkFailed(
            f"small boards: {late[0].form}, without limits, was late by {late[0].lag:.2f} s: the machine is too busy"
        )
    return figures


def _side_by_side(flights: Sequence[Wanted]) -> list[Flown]:
    """Fly some at once, each from a process of its own, so that they share nothing but the machine."""
    many = min(SIDE_BY_SIDE, len(flights))
    tell(f"{len(flights)} flights, {many} side by side")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(many, context, max_tasks_per_child=1) as pool:
        flown = []
        for place, wanted in enumerate(flights):
            flown.append(pool.submit(fly, wanted))
            if place < many:
                time.sleep(APART)
        return [one.result() for one in flown]


def _busy() -> float:
    """Return the seconds for which cores of the machine were busy so far; to wait for a disk is not."""
    times = psutil.cpu_times()
    return float(times.user + times.nice + times.system + times.irq + times.softirq + times.steal)


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of docs/measurements/benchmarks.md."""
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
