"""What is asked of the paper's missions: what the BDI approach may cost beside the imperative one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from benchmarks.flights import RESCUE, SINGLE
from benchmarks.paper.usage_figures import BDI, BOARD, IMPERATIVE, Figures, Usage
from benchmarks.parts import Goal
from benchmarks.sampling import AGENT

TITLES: Final = {SINGLE.mission: "single UAV", RESCUE.mission: "search and rescue"}
BOARD_GOAL: Final = 1.1
AGENT_MEMORY, AGENT_CPU = 1.3, 1.5
ONE_PAIR: Final = "; of one pair of flights"
CPU: Final = "CPU"
DOUBT: Final = 0.1
"""By so much may the processor time of a single pair be off by chance: pairs of the same flights differ as much."""
"""Chance is not excluded then."""
_CPU: Final = (
    "Taken to be the reason, not measured apart: AgentSpeak is interpreted by Python, so that each percept is held "
    "against beliefs and plans, where a program reads a value. Tried: a percept of the bus is known for one and no "
    "reason to write a checkpoint (3584cde); a mind turns in the pass of the loop that brings its percepts (6446a99); "
    "what is to be kept is looked for only when more than percepts came (4f513ce); numbers and words of percepts are "
    "read as they are (9654dc5)"
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
    return [_goal(figures, mission, speed, who) for mission, speed in figures.flown() for who in (BOARD, AGENT)]


def _goal(figures: Figures, mission: str, speed: float, who: str) -> Goal:
    memory, cpu = (BOARD_GOAL, BOARD_GOAL) if who == BOARD else (AGENT_MEMORY, AGENT_CPU)
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
        ", ".join(map(str, ratios)) + (ONE_PAIR if len(ratios[0].pairs) == 1 else "") + _lost(figures, mission, speed),
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


def _lost(figures: Figures, mission: str, speed: float) -> str:
    """Flights that were not done, if any: how many of how many, by approach."""
    told = [
        f"{len(one.again)} of {len(one.again) + len(one.flights)} {title}"
        for approach, title in ((BDI, "of the agents"), (IMPERATIVE, "of the programs"))
        if (one := figures.of(mission, speed, approach)).again
    ]
    return f"; flights lost: {', '.join(told)}" if told else ""


def _why(bdi: Usage, other: Usage, who: str, missed: list[Ratio]) -> str:
    mine, its = bdi.row(who), other.row(who)
    parts = []
    if any(one.what == CPU for one in missed):
        parts.append(f"{mine.cpu.mean:.2f} beside {its.cpu.mean:.2f} % of a core. {_CPU}")
    if any(one.what != CPU for one in missed):
        parts.append(f"{mine.rss.mean:.1f} beside {its.rss.mean:.1f} MB (RSS). {_MEMORY}")
    return "; ".join(parts)


def alone(bdi: Usage, other: Usage) -> float | None:
    """Return the ratio of what the boards would hold alone; None where the kernel does not tell."""
    return sum(bdi.alone.values()) / sum(other.alone.values()) if bdi.alone and other.alone else None
