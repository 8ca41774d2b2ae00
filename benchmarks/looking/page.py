"""What the benchmark of looking finds, and how docs/measurements/daemons.md tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from benchmarks import plots
from benchmarks.looking.bursts import STEPS, Cost
from benchmarks.paired import Interval
from benchmarks.parts import Goal, line_of_goals
from benchmarks.results import Origin

GOAL: Final = 2.0
"""Per cent of a busy agent's throughput that somebody who looks at it may take."""
LOOKING: Final = ("run", "watch")
PUT_AT_MOST: Final = 4.0
"""Hz at which a mind puts what it has done."""
VIEWS: Final = {"run": ("run",), "watch": ("watch",), "ui": ("watch", "deeds")}
"""What the commands that look on do: looks, and what they listen to."""


UNDECIDED: Final = (
    "the interval holds the goal: processor time of so short bursts differs more from one to the next than what a look "
    "takes; tried: neighbours of one round are compared; more rounds make the interval narrower"
)
_SPENT: Final = (
    "a look at a mind is made and encoded in the agent's own process; which part of it takes the most is not known "
    "here; tried: `argosy {view}` asks for no more than it shows, and deeds are put at most four times a second"
)


@dataclass
class Share:
    """What the daemon of three ordinary agents uses while somebody looks on."""

    title: str
    got: dict[str, float]
    """How often a second the onlooker was answered, and what it heard."""
    share: float
    """Per cent of a core."""
    more: Interval
    """Points more than with nobody."""


@dataclass
class Figures:
    """All that was measured."""

    rounds: int
    ordinary_rounds: int
    seconds: float
    """How often and how long."""
    rate: float
    """Looks a second for which the goal holds."""
    costs: list[Cost]
    watched: Interval
    alone: Interval
    """Per cent of cycles for each second of processor time that an agent which never rests loses by `argosy watch`, and
    by nobody: what the method is off by."""
    calm: float
    """Per cent of a core that three ordinary agents use with nobody."""
    shares: list[Share]

    def lost(self, parts: tuple[str, ...]) -> Interval | None:
        """Return the per cent of its throughput that a busy agent loses; None if a part of it was not measured."""
        found = {one.key: self._lost(one) for one in self.costs}
        if not all(part in found for part in parts):
            return None
        total = found[parts[0]]
        for part in parts[1:]:
            total = total.plus(found[part])
        return total

    def _lost(self, cost: Cost) -> Interval:
        if cost.key in LOOKING:  # milliseconds a look, so many looks a second
            return cost.extra.scaled(self.rate / 10)
        if cost.key == "deeds":  # what was done is put so often at most, however much it is
            return cost.extra.scaled(PUT_AT_MOST / 10 / max(cost.heard, 0.01))
        return cost.extra.scaled(100 / cost.work)  # inputs and decisions grow with the work


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of those that look on."""
    found = []
    for view, parts in VIEWS.items():
        lost = figures.lost(parts)
        if lost is not None:
            undecided = lost.low < GOAL <= lost.high
            title = f"what a busy agent loses by `argosy {view}` at {figures.rate:g} Hz"
            told, wanted = lost.told(" %", 2), f"under {GOAL:g} %, with 95 %"
            why = (UNDECIDED if undecided else _SPENT).format(view=view)
            found.append(Goal(title, wanted, told, lost.high < GOAL, why, decided=not undecided))
    return found


def pictures(figures: Figures) -> dict[str, str]:
    """Draw what each who looks on takes of an agent that never rests, with its interval, beside the goal."""
    found = [(f"argosy {view}", figures.lost(parts)) for view, parts in VIEWS.items()]
    rows = [(name, lost) for name, lost in reversed(found) if lost is not None]
    with plots.figure(height=1.0 + 0.35 * len(rows)) as (made, axes):
        for place, (_, lost) in enumerate(rows):
            low, high = lost.median - lost.low, lost.high - lost.median
            axes.errorbar(lost.median, place, xerr=[[low], [high]], fmt="o", color=plots.COLOURS["agentd"], capsize=3)
        axes.axvline(GOAL, color=plots.COLOURS["paper"], linestyle="--")
        axes.set_yticks(range(len(rows)), [name for name, _ in rows])
        axes.set_ylim(-0.5, len(rows) - 0.5)
        axes.set_xlim(left=min(0.0, *(lost.low for _, lost in rows)))
        axes.set_xlabel("% that an agent loses which never rests, with intervals of 95 %; dashed: the goal")
        return {"looking": plots.svg(made)}


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/measurements/daemons.md."""
    lines = [
        origin.line(),
        "",
        *line_of_goals(goals(figures)),
        "",
        "![what agents lose by being looked at](figures/looking.svg)",
        "",
        f"Processor time of agentd, all threads, for a burst of {STEPS} steps of a program, with and without somebody; "
        "medians of differences, in brackets their intervals of 95 %.",
        "",
        "| who looks on | bursts | a burst alone | more by one look, or by being heard | lost |",
        "|---|---|---|---|---|",
    ]
    for cost in figures.costs:
        lost = figures.lost((cost.key,))
        assert lost is not None
        rate = (
            f" at {figures.rate:g} Hz"
            if cost.key in LOOKING
            else f" at {PUT_AT_MOST:g} Hz"
            if cost.key == "deeds"
            else ""
        )
        cells = [cost.title, f"{cost.extra.count}", f"{cost.work:.1f} ms", cost.extra.told(" ms", 2)]
        lines.append(f"| {' | '.join(cells)} | {lost.told(' %', 2)}{rate} |")
    lines += [
        "",
        f"An agent that never rests, end to end, {figures.rounds} stretches of {figures.seconds:g} s with somebody, "
        f"each between two with nobody: by `argosy watch` it lost {figures.watched.told(' %')} of its cycles per "
        f"processor time, by nobody {figures.alone.told(' %')}.",
        "",
        f"Three agents of three vehicles in one agentd, all of them looked at, {figures.ordinary_rounds} stretches of "
        f"{figures.seconds:g} s each. With nobody it takes {figures.calm:.1f} % of a core:",
        "",
        "| who looks on | what it gets | agentd, % of a core | more than with nobody |",
        "|---|---|---|---|",
    ]
    for share in figures.shares:
        got = ", ".join(f"{rate:.1f} {what}/s" for what, rate in share.got.items()) or "nothing"
        lines.append(f"| {share.title} | {got} | {share.share:.1f} % | {share.more.told(' points')} |")
    return {"looking": "\n".join(lines)}
