"""What `usage` found, drawn: one flight of each mission by both approaches; ratios beside the paper's."""

from __future__ import annotations

from typing import Any, Final

from benchmarks.flights import RESCUE
from benchmarks.paper.usage_figures import BDI, BOARD, Figures
from benchmarks.paper.usage_goals import BOARD_GOAL, TITLES
from benchmarks.paper.usage_page import APPROACHES, paper_ratios, picture_of
from benchmarks.plots import COLOURS, figure, svg
from benchmarks.sampling import AGENT

SMOOTH: Final = 15
"""Samples of which a line of the plots is the mean."""


def pictures(figures: Figures) -> dict[str, str]:
    """Return the plots: one flight of each mission by both approaches, and the ratios."""
    found = {
        picture_of(mission): _flight(figures, mission) for mission in dict.fromkeys(d.mission for d in figures.drawn)
    }
    return {**found, "usage-ratios": _bars(figures)}


def _flight(figures: Figures, mission: str) -> str:
    with figure(columns=2) as (made, (cpu, memory)):
        for one in (drawn for drawn in figures.drawn if drawn.mission == mission):
            colour = COLOURS["agentd" if one.approach == BDI else "python"]
            title = APPROACHES[one.approach]
            for who, style in ((BOARD, "-"), (AGENT, ":")):
                label = f"{title}, {'board' if who == BOARD else 'agent'}"
                if who == BOARD:
                    cpu.plot(one.at, one.cpu[who], color=colour, linewidth=0.5, alpha=0.4)
                cpu.plot(one.at, _smooth(one.cpu[who]), style, color=colour, linewidth=1, label=label)
                memory.plot(one.at, one.rss[who], style, color=colour, linewidth=1, label=label)
        several = " (mean of the boards)" if mission == RESCUE.mission else ""
        made.suptitle(
            f"{TITLES[mission]}, speed 1{several}; CPU: each sample of a board, and means of {SMOOTH}", fontsize=9
        )
        cpu.set(xlabel="s", ylabel="CPU, % of a core", ylim=(0, None))
        memory.set(xlabel="s", ylabel="RSS, MB", ylim=(0, None))
        memory.legend(fontsize=7)
        return svg(made)


def _smooth(values: list[float]) -> list[float]:
    around = [values[max(0, place - SMOOTH // 2) : place + SMOOTH // 2 + 1] for place in range(len(values))]
    return [sum(some) / len(some) for some in around]


def _bars(figures: Figures) -> str:
    bars: list[tuple[str, float, float, str]] = []
    for title, (cpu, memory), _ in paper_ratios():
        bars.append((title, cpu, memory, COLOURS["paper"]))
    for mission, speed in figures.flown():
        mine, its = (figures.of(mission, speed, approach).row(BOARD) for approach in APPROACHES)
        label = f"{TITLES[mission]}, speed {speed:g}"
        bars.append((label, mine.cpu.mean / its.cpu.mean, mine.rss.mean / its.rss.mean, COLOURS["agentd"]))
    with figure(columns=2, height=2.8) as (made, panels):
        for axes, index, title in ((panels[0], 1, "CPU"), (panels[1], 2, "memory")):
            _panel(axes, bars, index, f"a board's {title}: BDI / imperative")
        panels[1].set_yticklabels([])
        return svg(made)


def _panel(axes: Any, bars: list[tuple[str, float, float, str]], index: int, title: str) -> None:
    values: list[float] = [float(bar[index]) for bar in bars]
    axes.barh(range(len(bars)), values, color=[bar[3] for bar in bars])
    axes.set_yticks(range(len(bars)), [bar[0] for bar in bars])
    for place, value in enumerate(values):
        axes.annotate(
            f"{value:.2f}", (value, place), xytext=(2, 0), textcoords="offset points", va="center", fontsize=8
        )
    axes.axvline(BOARD_GOAL, color="black", linewidth=0.8, linestyle="--")
    axes.invert_yaxis()
    axes.set_xlim(0, 1.15 * max(values))
    axes.set_title(title, fontsize=9)
