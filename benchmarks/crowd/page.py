"""The section of docs/scaling.md about many agents in one daemon, and its pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks import fits, plots
from benchmarks.crowd.run import Crowd, Loaded
from benchmarks.results import Origin

if TYPE_CHECKING:
    from benchmarks.crowd.part import Figures


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    parts = [
        origin.line(),
        f"An fsync of this disk takes {figures.fsync:.2f} ms. Per cent are of one core.",
        _at_rest(figures.crowds),
        _grows(figures.crowds),
        "![what a crowd costs by its size](figures/crowd-cost.svg)",
        "At once:",
        _talking([(one, one.hurried) for one in figures.crowds if one.hurried]),
        f"At ease, one question of each agent within {figures.pace:g} s:",
        _talking([(one, one.eased) for one in figures.crowds if one.eased]),
        "![messages and latency by the size of the crowd](figures/crowd-mail.svg)",
        _outgrown(figures),
    ]
    return {"crowd": "\n\n".join(part for part in parts if part)}


def _at_rest(crowds: list[Crowd]) -> str:
    rows = [
        "| agents | starts in | processor time of the start | memory of agentd | for each agent more "
        "| at rest: agentd, commd | ends in |",
        "|---|---|---|---|---|---|---|",
    ]
    first = crowds[0]
    for one in crowds:
        more = one.agents - first.agents
        each = f"{(one.rss - first.rss) / more:.2f} MB" if more else ""
        rows.append(
            f"| {one.agents:,} | {one.start:.1f} s | {one.cpu_start:.1f} s | {one.rss:.0f} MB | {each} "
            f"| {one.idle:.1f} %, {one.commd_idle:.1f} % | {one.stop:.1f} s |"
        )
    return "\n".join(rows)


def _grows(crowds: list[Crowd]) -> str:
    if len(crowds) < 3:
        return ""
    told = []
    for what, points in (
        ("memory", [(one.agents, one.rss) for one in crowds]),
        ("the processor time of the start", [(one.agents, one.cpu_start) for one in crowds]),
        ("agentd at rest", [(one.agents, one.idle) for one in crowds]),
        ("commd at rest", [(one.agents, one.commd_idle) for one in crowds]),
    ):
        told.append(f"{what} as size ^ {fits.power([(float(size), cost) for size, cost in points]):.2f}")
    return f"By size the fits are: {', '.join(told)} (1 = in proportion)."


def _talking(rows: list[tuple[Crowd, Loaded]]) -> str:
    head = [
        "| agents | messages/s | question to answer, p50 | p99 | worst | slowest agent against the median one "
        "| agentd | commd |",
        "|---|---|---|---|---|---|---|---|",
    ]
    return "\n".join(
        head
        + [
            f"| {one.agents:,} | {load.rate:.0f} | {load.p50:.0f} ms | {load.p99:.0f} ms | {load.worst:.0f} ms "
            f"| x {load.fairness:.1f} | {load.agentd:.0f} % | {load.commd:.0f} % |"
            for one, load in rows
        ]
    )


def _outgrown(figures: Figures) -> str:
    """Say from which of the sizes on a crowd cannot keep up."""
    late = [
        one for one in figures.crowds if one.eased is not None and one.eased.rate < one.agents * 2 / figures.pace / 2
    ]
    asked = f"one question of each agent in {figures.pace:g} s"
    sizes = ", ".join(f"{one.agents:,}" for one in figures.crowds)
    if not late:
        return f"Of the sizes measured ({sizes}) every one keeps up with {asked}."
    return (
        f"Of the sizes measured ({sizes}), {late[0].agents:,} agents do not keep up with {asked}: one agentd and one "
        "board are outgrown there."
    )


def pictures(figures: Figures) -> dict[str, str]:
    """Draw what a crowd costs, and how it talks."""
    crowds = figures.crowds
    sizes = [one.agents for one in crowds]
    with plots.figure(2) as (made, axes):
        axes[0].plot(sizes, [one.rss for one in crowds], "o-", color=plots.COLOURS["agentd"], label="agentd, MB")
        axes[1].plot(sizes, [one.cpu_start for one in crowds], "o-", label="start, s of processor time")
        axes[1].plot(
            sizes, [one.idle for one in crowds], "o-", color=plots.COLOURS["agentd"], label="agentd, % at rest"
        )
        axes[1].plot(
            sizes, [one.commd_idle for one in crowds], "o-", color=plots.COLOURS["commd"], label="commd, % at rest"
        )
        for one in axes:
            one.set_xlabel("agents")
            one.legend(fontsize=7)
        cost = plots.svg(made)
    talking = [one for one in crowds if one.hurried and one.eased]
    with plots.figure(2) as (made, axes):
        sizes = [one.agents for one in talking]
        axes[0].plot(sizes, [one.hurried.rate for one in talking if one.hurried], "o-", label="messages/s, at once")
        for load, style in (("hurried", "o-"), ("eased", "s--")):
            shown = "at once" if load == "hurried" else "at ease"
            axes[1].plot(sizes, [getattr(one, load).p50 for one in talking], style, label=f"p50, {shown}")
            axes[1].plot(sizes, [getattr(one, load).p99 for one in talking], style, label=f"p99, {shown}")
        axes[1].set_yscale("log")
        axes[1].set_ylabel("ms from question to answer")
        for one in axes:
            one.set_xscale("log")
            one.set_xlabel("agents")
            if talking:
                one.legend(fontsize=7)
        return {"crowd-cost": cost, "crowd-mail": plots.svg(made)}
