"""The section of docs/measurements/scaling.md about fleets of several routers, and its picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from benchmarks import plots
from benchmarks.results import Origin
from benchmarks.routers.load import SESSIONS

if TYPE_CHECKING:
    from benchmarks.routers.part import Figures

TITLES: Final = {
    "n2-n1": "n2 - n1, within a site",
    "n1-s1": "n1 - s1, between the sites",
    "s1-s2": "s1 - s2, within a site",
}


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the tables."""
    return {"routers": "\n".join([origin.line(), "", *_links(figures), "", *_sizes(figures), "", *_router(figures)])}


def _links(figures: Figures) -> list[str]:
    return [
        f"Two sites of two boards, {figures.each} UAVs with their agents on each board, {4 * figures.each} in all:",
        "",
        "![What crosses the links](figures/routers-links.svg)",
        "",
        f"| bytes a second, both ways | {' | '.join(TITLES.values())} |",
        f"|---|{'---|' * len(TITLES)}",
        *(f"| {one.what} | {' | '.join(f'{one.links[link]:,.0f}' for link in TITLES)} |" for one in figures.stretches),
        "",
        f"While all bridges and agents started, {figures.starting['n1-s1'] / 1000:,.1f} kB crossed the link between "
        f"the sites, {figures.starting['n1-s1'] / (4 * figures.each):,.0f} bytes for each UAV with its agent: what "
        "they serve, what they hear and that they are there is declared to every router.",
        "Bytes are those that the TCP connections between routers carry, both ways: what IP and TCP add to each packet "
        "(headers, acknowledgements) is not in them.",
        f"Each agent that asks waits {figures.ask_every:g} s between an answer and its next question.",
    ]


def _sizes(figures: Figures) -> list[str]:
    return [
        "| bytes between the sites, both ways, for | |",
        "|---|---|",
        *(f"| {what} | {round(size):,} |" for what, size in figures.sizes.items()),
    ]


def _router(figures: Figures) -> list[str]:
    unpaced = [one for one in figures.loads if not one.wanted]
    most = max(figures.loads, key=lambda one: one.came)
    paced = [one for one in figures.loads if one.wanted and one.came > 0.95 * one.wanted] or figures.loads
    fullest = max(paced, key=lambda one: one.came)
    return [
        f"One router and percepts of {figures.payload} bytes, from {SESSIONS} sessions (of one process) to one who "
        "listens to all; a router without a commd's mail:",
        "",
        "| percepts a second: put | arrived | router, % of a core | of the router for each, us |",
        "|---|---|---|---|",
        *(
            f"| {f'{one.put:,.0f}'}{'' if one.wanted else ' (as fast as it goes)'} | {one.came:,.0f} | "
            f"{one.router:.0f} | {one.microseconds:.1f} |"
            for one in figures.loads
        ),
        "",
        f"At {fullest.microseconds:.1f} us for each, all threads of the router together take a whole core at "
        f"{1e6 / fullest.microseconds:,.0f} percepts a second. Here {most.came:,.0f} a second arrived at most"
        + (
            ": what is put beyond it is dropped, as percepts are, and repaired by the bridge's digest."
            if unpaced
            else "."
        )
        + " That is a limit of this machine, not of a router: who puts and who listens, both in Python, share its "
        "cores.",
        *_uavs(figures, 1e6 / fullest.microseconds),
    ]


def _uavs(figures: Figures, full: float) -> list[str]:
    """Say how many UAVs that makes."""
    if not figures.percepts:
        return []
    return [
        "",
        f"One UAV that flies here tells {figures.percepts:.1f} percepts a second, as its bridge counts them. If each "
        f"is heard by one, its agent, a core of a router is full at **about {full / figures.percepts:,.0f} UAVs**: by "
        "calculation, not measured, for percepts alone, and put by declared publishers, whose routes a router keeps: "
        "records that daemons put without one cost it more, the more is declared. A board's `commd` has more to do: "
        "mail, questions, health and all that is declared; what it takes of a core is measured "
        "[above](#a-fleet-on-one-router).",
    ]


def pictures(figures: Figures) -> dict[str, str]:
    """Return bars of what crosses the links."""
    with plots.figure(height=3.2) as (made, axes):
        width = 0.8 / len(TITLES)
        for place, (link, title) in enumerate(TITLES.items()):
            at = [number + place * width for number in range(len(figures.stretches))]
            axes.barh(at, [one.links[link] / 1000 for one in figures.stretches], width, label=title)
        axes.set_yticks([number + 0.3 for number in range(len(figures.stretches))])
        axes.set_yticklabels([one.what.replace("`", "") for one in figures.stretches])
        axes.invert_yaxis()
        axes.set_xlabel("kB/s on the link, both ways")
        axes.legend(fontsize=7)
        return {"routers-links": plots.svg(made)}
