"""The section of docs/measurements/scaling.md about many agents in one daemon, and its pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from benchmarks import fits, plots
from benchmarks.crowd.run import Crowd, Loaded
from benchmarks.results import Origin

if TYPE_CHECKING:
    from benchmarks.crowd.part import Figures

KEEPS_UP: Final = 0.8
"""A crowd at its ease keeps up if it makes so large a part of the messages a second that are asked of it..."""
IN_TIME: Final = 10
"""... and 99 of 100 of its questions are answered within the pace divided by this."""


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    parts = [
        origin.line(),
        f"An fsync of this disk takes {figures.fsync:.2f} ms. Per cent are of one core.",
        _at_rest(figures.crowds),
        _grows(figures.crowds),
        "![what a crowd costs by its size](figures/crowd-cost.svg)",
        "At once (the time in which all are told to begin counts too):",
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
    if len(crowds) < fits.SIZES:
        return ""
    told = []
    for what, points in (
        ("memory", _points(crowds, "rss")),
        ("the processor time of the start", _points(crowds, "cpu_start")),
        ("agentd at rest", _points(crowds, "idle")),
        ("commd at rest", _points(crowds, "commd_idle")),
    ):
        growth = fits.power(points)
        told.append(f"{what}: {growth}, off by {growth.off:.0%} at worst")
    return f"How it grows, by least squares (size ^ 1 = in proportion): {'; '.join(told)}."


def _points(crowds: list[Crowd], what: str) -> list[tuple[float, float]]:
    return [(float(one.agents), getattr(one, what)) for one in crowds]


def _talking(rows: list[tuple[Crowd, Loaded]]) -> str:
    head = [
        "| agents | questions | answered | messages/s | question to answer, p50 | p99 | worst "
        "| slowest agent against the median one | agentd | commd |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    return "\n".join(
        head
        + [
            f"| {one.agents:,} | {load.asked:,} | {load.answered:,} | {load.rate:.0f} | {load.took.p50:.0f} ms "
            f"| {load.took.p99:.0f} ms | {load.took.max:.0f} ms | x {load.fairness:.1f} "
            f"| {load.agentd:.0f} % | {load.commd:.0f} % |"
            for one, load in rows
        ]
    )


def _late(one: Crowd, pace: float) -> str:
    """Return what a crowd at its ease did not get, in words; empty: it keeps up."""
    if one.hurried is None:  # one alone has nobody to ask
        return ""
    load = one.eased
    if load is None:
        return "questions asked at once were still not answered"
    if not load.all_answered:
        return f"{load.asked - load.answered:,} of {load.asked:,} questions were not answered"
    wanted = 2 * one.agents / pace
    if load.rate < KEEPS_UP * wanted:
        return f"{load.rate:.0f} messages/s, {wanted:.0f} are asked"
    if load.took.p99 > 1000 * pace / IN_TIME:
        return f"p99 of an answer is {load.took.p99 / 1000:.1f} s"
    return ""


def _outgrown(figures: Figures) -> str:
    """Say from which of the sizes on a crowd cannot keep up."""
    pace = figures.pace
    criterion = (
        f"one question of each agent in {pace:g} s: all are answered, at {KEEPS_UP:.0%} of that pace at least, and "
        f"99 of 100 within {pace / IN_TIME:g} s"
    )
    sizes = ", ".join(f"{one.agents:,}" for one in figures.crowds)
    late = [(one, why) for one in figures.crowds if (why := _late(one, pace))]
    if not late:
        return f"Of the sizes measured ({sizes}) every one keeps up with {criterion}."
    (first, why), *_ = late
    return (
        f"Of the sizes measured ({sizes}), {first.agents:,} agents are the smallest that do not keep up with "
        f"{criterion}. There {why}: one agentd and one board are outgrown at that size."
    )


def pictures(figures: Figures) -> dict[str, str]:
    """Draw what a crowd costs, and how it talks."""
    crowds = figures.crowds
    sizes = [one.agents for one in crowds]
    with plots.figure(2) as (made, axes):
        axes[0].plot(sizes, [one.rss for one in crowds], "o-", color=plots.COLOURS["agentd"], label="agentd, MB")
        axes[1].plot(
            sizes, [one.cpu_start for one in crowds], "o-", color="#666666", label="start, s of processor time"
        )
        axes[1].plot(
            sizes, [one.idle for one in crowds], "o-", color=plots.COLOURS["agentd"], label="agentd, % at rest"
        )
        axes[1].plot(
            sizes, [one.commd_idle for one in crowds], "o-", color=plots.COLOURS["commd"], label="commd, % at rest"
        )
        if len(crowds) >= fits.SIZES:
            for one, what in ((axes[0], "rss"), (axes[1], "cpu_start"), (axes[1], "idle"), (axes[1], "commd_idle")):
                growth = fits.power(_points(crowds, what))
                one.plot(sizes, [growth.at(size) for size in sizes], ":", color="black", linewidth=0.9)
        for one in axes:
            one.set_xlabel("agents")
            one.legend(fontsize=7)
        made.suptitle("dotted: fitted", fontsize=9)
        cost = plots.svg(made)
    talking = [one for one in crowds if one.hurried and one.eased]
    with plots.figure(2) as (made, axes):
        sizes = [one.agents for one in talking]
        axes[0].plot(sizes, [one.hurried.rate for one in talking if one.hurried], "o-", label="messages/s, at once")
        for load, style in (("hurried", "o-"), ("eased", "s--")):
            shown = "at once" if load == "hurried" else "at ease"
            axes[1].plot(sizes, [getattr(one, load).took.p50 for one in talking], style, label=f"p50, {shown}")
            axes[1].plot(sizes, [getattr(one, load).took.p99 for one in talking], style, label=f"p99, {shown}")
        axes[1].set_yscale("log")
        axes[1].set_ylabel("ms from question to answer")
        for one in axes:
            one.set_xscale("log")
            one.set_xlabel("agents")
            if talking:
                one.legend(fontsize=7)
        return {"crowd-cost": cost, "crowd-mail": plots.svg(made)}
