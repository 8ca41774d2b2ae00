"""The figures of small boards as Markdown (`benchmarks.small_boards.part`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from benchmarks import peers
from benchmarks.pages import table
from benchmarks.parts import Goal
from benchmarks.results import Origin
from benchmarks.small_boards.control_groups import Limits

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

    boards: list[Flown]
    """With the limits of boards."""
    free: list[Flown]
    """Without limits, one of each form."""
    side_by_side: int
    """Flights at once, at most."""
    busy: float
    """Cores of the machine that were busy meanwhile, in the mean."""


def block(origin: Origin, figures: Figures) -> str:
    """Return the block of docs/measurements/benchmarks.md."""
    parts = [
        origin.line(),
        "The paper's first mission (section 5.1) at speed 1 with all daemons of its board held within the limits of a "
        f"small one by {figures.free[0].kept_by}; the simulator, on another computer in the paper, is outside. **No "
        "such board was at hand**: memory is the board's own, and what share of a core here stands for one of its "
        "cores is derived from published figures (DMIPS per MHz of its core) and an assumption: that a core here does "
        f"{OUR_DMIPS:,.0f} DMIPS, 10 per MHz at 4 GHz. On a slower machine than that a board is given less than it "
        "has.",
        "\n".join(_given()),
        f"At most {figures.side_by_side} flights were flown side by side, and their simulators; {figures.busy:.1f} "
        "cores of the machine were busy meanwhile. The two without limits were flown before them, side by side, and "
        f"were late by {max(one.lag for one in figures.free):.2f} s at worst. Only memory and the share of a "
        "core are limited. **Not modelled**: a small board's caches and memory bandwidth, its SD card, a processor of "
        "32 bits with a build of Python and libraries of its own.",
        "\n".join(_flights([*figures.free, *figures.boards])),
        "*Ready*: seconds from the start until all daemons were there. *Held*: at most, and each page once, as if "
        "nobody else on the machine had read the same libraries. *Held back*: seconds for which processes that had "
        "work to do had used up their share. *Late*: by how much a daemon's loop was behind at worst in flight. In the "
        f"paper, on a BeagleBone Black, the agents in Jason were {peers.BEAGLEBONE}; all of their nodes together hold "
        f"{peers.mb(peers.JASON_BOARD[0]):.0f} to {peers.mb(peers.JASON_BOARD[1]):.0f} MB.",
    ]
    return "\n\n".join(parts)


def _given() -> list[str]:
    rows = [
        f"| {board.title} | {board.memory:.0f} MB | {SYSTEM:.0f} MB | {board.limits.memory:.0f} MB "
        f"| {board.cores} x {board.clock:.0f} MHz {board.core}, {board.dmips_per_mhz:g} DMIPS per MHz "
        f"| {board.share:.1%} |"
        for board in BOARDS
    ]
    return table(
        "| board | memory | left to its system | left to the daemons | cores | a core of it, of one here |", rows
    )


def _flights(flights: Sequence[Flown]) -> list[str]:
    rows = [
        f"| {one.board} | {one.form} | completed | {one.ready:.1f} | {one.mission:.1f} | {one.held:.0f} "
        f"| {one.cpu:.1f} | {one.throttled:.1f} | {one.lag:.2f} | {one.timed_out} |"
        if one.completed
        else f"| {one.board} | {one.form} | **{one.why}** | | | | | | | |"
        for one in flights
    ]
    return table(
        "| limits of | | mission | ready, s | mission, s | held, MB | processor, % of a core | held back, s | late, s "
        "| actions timed out |",
        rows,
    )


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
        why = "" if met else _why(flights)
        title = f"single-UAV mission within the limits of a {board}"
        found.append(Goal(title, "completed", "; ".join(words), met, why))
    return found


def _why(flights: Sequence[Flown]) -> str:
    """Return why a mission was not completed, as far as it is known."""
    lost = [one for one in flights if not one.completed]
    told = "; ".join(
        f"{one.form} held {one.held:.0f} MB at most and was held back for {one.throttled:.1f} s" for one in lost
    )
    return f"{told}; which of the limits it is, is not known"


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
