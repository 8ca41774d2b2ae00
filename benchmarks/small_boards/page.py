"""The figures of small boards as Markdown and as a picture (`benchmarks.small_boards.part`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from benchmarks import peers, plots
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

    shares: list[Flown]
    """With shares of one core, and as much memory as there is."""
    boards: list[Flown]
    """With the limits of boards."""
    memory: list[Flown]
    """With little memory, and all that there is of the processor."""
    free: list[Flown]
    """Without limits, one of each form."""
    side_by_side: int
    """Flights at once, at most."""
    busy: float
    """Cores of the machine that were busy meanwhile, in the mean."""


COLOURS: Final = (plots.COLOURS["agentd"], plots.COLOURS["bridged"])


def block(origin: Origin, figures: Figures, boards: Sequence[Board], system: float, dmips: float) -> str:
    """Return the block of docs/measurements/benchmarks.md."""
    parts = [
        origin.line(),
        "The paper's first mission (section 5.1) at speed 1 with all daemons of its board held within the limits of a "
        f"small one by {figures.free[0].kept_by}; the simulator, on another computer in the paper, is outside. **No "
        "such board was at hand**: memory is the board's own, and what share of a core here stands for one of its "
        "cores is derived from published figures (DMIPS per MHz of its core) and an assumption: that a core here does "
        f"{dmips:,.0f} DMIPS, 10 per MHz at 4 GHz. On a slower machine than that a board is given less than it has.",
        "\n".join(_given(boards, system)),
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
        "![what a board holds, and how long it takes with less of a core](figures/small-boards.svg)",
        f"**The least that is enough**, without any assumption about boards: {least(figures)}. What was tried, each "
        "with the other left free:",
        "\n".join(_tried(figures)),
    ]
    return "\n\n".join(parts)


def _given(boards: Sequence[Board], system: float) -> Iterator[str]:
    yield "| board | memory | left to its system | left to the daemons | cores | a core of it, of one here |"
    yield "|---|---|---|---|---|---|"
    for board in boards:
        yield (
            f"| {board.title} | {board.memory:.0f} MB | {system:.0f} MB | {board.memory - system:.0f} MB "
            f"| {board.cores} x {board.clock:.0f} MHz {board.core}, {board.dmips_per_mhz:g} DMIPS per MHz "
            f"| {board.share:.1%} |"
        )


def _flights(flights: Sequence[Flown]) -> Iterator[str]:
    yield (
        "| limits of | | mission | ready, s | mission, s | held, MB | processor, % of a core | held back, s | late, s "
        "| actions timed out |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for one in flights:
        if one.completed:
            yield (
                f"| {one.board} | {one.form} | completed | {one.ready:.1f} | {one.mission:.1f} | {one.held:.0f} "
                f"| {one.cpu:.1f} | {one.throttled:.1f} | {one.lag:.2f} | {one.timed_out} |"
            )
        else:
            yield f"| {one.board} | {one.form} | **{one.why}** | | | | | | | |"


def _tried(figures: Figures) -> Iterator[str]:
    yield "| | given | mission | ready, s | mission, s | late, s |"
    yield "|---|---|---|---|---|---|"
    for one in [*figures.shares, *figures.memory]:
        given = f"{one.share:.1%} of a core" if one.share is not None else f"{given_memory(figures, one):.0f} MB"
        if one.completed:
            yield f"| {one.form} | {given} | completed | {one.ready:.1f} | {one.mission:.1f} | {one.lag:.2f} |"
        else:
            yield f"| {one.form} | {given} | {one.why} | {f'{one.ready:.1f}' if one.ready else ''} | | |"


def given_memory(figures: Figures, one: Flown) -> float:
    """Return the MB that a flight was given, with the pages that were not charged to it."""
    free = next(flown for flown in figures.free if flown.form == one.form)
    return (one.memory or 0.0) + free.elsewhere


def smallest_share(figures: Figures, form: str) -> float | None:
    """Return the smallest share down to which every flight of a form was completed."""
    found = None
    for one in sorted((f for f in figures.shares if f.form == form), key=lambda f: -(f.share or 0.0)):
        if not one.completed:
            break
        found = one.share
    return found


def smallest_memory(figures: Figures, form: str) -> float | None:
    """Return the smallest memory in MB down to which every flight of a form was completed."""
    found = None
    for one in sorted((f for f in figures.memory if f.form == form), key=lambda f: -(f.memory or 0.0)):
        if not one.completed:
            break
        found = given_memory(figures, one)
    return found


def least(figures: Figures) -> str:
    """Return with how little each form still completes the mission, in words."""
    parts = []
    for form in dict.fromkeys(one.form for one in figures.free):
        share, memory = smallest_share(figures, form), smallest_memory(figures, form)
        parts.append(
            f"{form} with {'none of the tried shares' if share is None else f'{share:.1%}'} of one core of this "
            f"machine, and {'no memory that was tried' if memory is None else f'{memory:.0f} MB'}"
        )
    return "; ".join(parts)


def goals(figures: Figures) -> list[Goal]:
    """Return the goals: the mission is completed on each board, in both forms."""
    found = []
    for board in dict.fromkeys(one.board for one in figures.boards):
        flights = [one for one in figures.boards if one.board == board]
        words = [f"{one.form}: {f'completed, {one.held:.0f} MB' if one.completed else one.why}" for one in flights]
        met = all(one.completed for one in flights)
        why = "" if met else _why(figures, flights)
        title = f"single-UAV mission within the limits of a {board}"
        found.append(Goal(title, "completed", "; ".join(words), met, why))
    return found


def _why(figures: Figures, flights: Sequence[Flown]) -> str:
    """Return why a mission was not completed, as far as it is known, and what was tried."""
    lost = [one for one in flights if not one.completed]
    told = "; ".join(
        f"{one.form} held {one.held:.0f} MB at most and was held back for {one.throttled:.1f} s" for one in lost
    )
    return f"{told}; tried, to see which of the limits it is: {least(figures)}"


def in_short(figures: Figures, title: str) -> list[str]:
    """Return the row of the README's table: what became of the mission within the limits of the board of that title."""
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


def picture(figures: Figures, limits: dict[str, float]) -> str:
    """Draw what a board holds beside its limits and the paper, and how long it takes with less of a core."""
    forms = list(dict.fromkeys(one.form for one in figures.free))
    with plots.figure(columns=2, width=9.0) as (made, (left, right)):
        held = [one.held for one in figures.free]
        left.bar([form.strip("`") for form in forms], held, color=COLOURS, width=0.5)
        left.bar(["the paper's,\nin Jason"], [peers.mb(peers.JASON_BOARD[0])], color=plots.COLOURS["paper"], width=0.5)
        for title, limit in limits.items():
            left.axhline(limit, color="black", lw=0.8, ls="--")
            where = left.get_yaxis_transform()
            left.text(0.02, limit, f"left by a {title}: {limit:.0f}", va="bottom", fontsize=8, transform=where)
        left.set_ylabel("MB held by the board")
        left.set_ylim(0, max(limits.values()) * 1.1)
        for form, colour in zip(forms, COLOURS, strict=True):
            tried = [*figures.shares, *(one for one in figures.boards if one.cores == 1)]
            flown = sorted((f for f in tried if f.form == form and f.completed), key=lambda f: f.share or 0.0)
            name = form.strip("`")
            shares = [100 * (one.share or 0.0) for one in flown]
            right.plot(shares, [one.ready for one in flown], "o--", color=colour, label=f"{name}: ready")
            right.plot(shares, [one.mission for one in flown], "o-", color=colour, label=f"{name}: mission")
            lost = [100 * (f.share or 0.0) for f in tried if f.form == form and not f.completed]
            right.plot(lost, [0.0] * len(lost), "x", color=colour, label=f"{name}: not completed" if lost else None)
        right.set_xlabel("% of one core here for the whole board")
        right.set_ylabel("s")
        right.set_ylim(bottom=-5)
        right.legend(fontsize=7, handlelength=3.5, loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
        return plots.svg(made)
