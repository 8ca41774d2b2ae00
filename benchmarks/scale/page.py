"""The block of the part "scale": its tables, and what was missed. What follows from them: `benchmarks.scale.growth`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchmarks.bridge.traffic import POSITIONS, RATES
from benchmarks.results import Origin
from benchmarks.scale.found import BEAT_LATE, Run
from benchmarks.scale.growth import DAEMONS, FULL, outgrown
from benchmarks.scale.mission import ASK_EVERY
from benchmarks.scale.run import PATIENCE

if TYPE_CHECKING:
    from benchmarks.scale.part import Figures


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the text of the page's block."""
    talkers, apart, copters = figures.of("talkers"), figures.of("talkers", own_links=True), figures.of("copters")
    parts = [
        origin.line(),
        _about(talkers),
        "### What it costs",
        "UAVs that only talk, all on one link and so in one bridge, as robots are that share a link:",
        _costs(talkers),
        "The same, each on a link of its own, and so with a bridge of its own:",
        _costs(apart),
        "Simulated copters in flight, all on one link, and one UAV more that only talks, for the latency:",
        _costs(copters),
        _beside(copters),
        "![processor time and memory by the number of UAVs](figures/scale-cost.svg)",
        "### How late it is",
        _lateness([*talkers, *apart, *copters]),
        "![latency by the number of UAVs](figures/scale-latency.svg)",
        "### What is missed",
        _missed([*talkers, *apart, *copters]),
        "### What is outgrown, and when",
        *outgrown(talkers, origin),
    ]
    return {"scale": "\n\n".join(part for part in parts if part)}


def _about(row: list[Run]) -> str:
    sizes = ", ".join(str(one.size) for one in row[:-1]) + f" and {row[-1].size}"
    return (
        f"{sizes} UAVs, each a robot with the manifest `arducopter`, and its agent, on one board: one `commd` (the "
        f"router), one `agentd`. A UAV that only talks flies a circle and sends {sum(RATES.values())} MAVLink messages "
        f"a second, its position {POSITIONS} times. Every agent asks its vehicle for a parameter "
        f"{ASK_EVERY / 1000:g} s after it has had the last answer: an action with a status and a percept. Each size "
        f"was looked at for {row[-1].seconds:.0f} s at speed 1. Per cent are of one core."
    )


def _costs(row: list[Run]) -> str:
    if not row:
        return ""
    head = (
        "| UAVs | bridges | messages/s | percepts/s of a UAV | commd | bridged | agentd | daemons "
        "| vehicles | cores busy | PSS of the daemons, MB | of it commd, bridged, agentd | ready after |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    for one in row:
        vehicles = sum(one.use[kind].cpu for kind in ("simulator", "talkers") if kind in one.use)
        each = " | ".join(f"{one.use[kind].cpu:.1f} %" for kind in DAEMONS)
        pss = ", ".join(f"{one.use[kind].pss:.0f}" for kind in DAEMONS)
        lines.append(
            f"| {one.size} | {one.use['bridged'].processes} | {one.messages:.0f} "
            f"| {one.percepts / (one.size + (one.vehicles == 'copters')):.1f} | {each} | {one.cpu():.1f} % "
            f"| {vehicles:.0f} % | {one.busy:.0f} % | {one.pss():.0f} | {pss} | {one.ready:.1f} s |"
        )
    return "\n".join(lines)


def _beside(row: list[Run]) -> str:
    """Whether the simulators kept up, and what of the row can be read."""
    if not row:
        return ""
    said = []
    for one in row:
        simulators = one.use["simulator"]
        factor = 1 - one.never_happened / (one.seconds * simulators.processes)
        each = simulators.cpu / simulators.processes
        said.append(
            f"| {one.size} | {each:.1f} % | {simulators.rss / simulators.processes:.0f} MB | {one.late_rounds} "
            f"| {factor:.3f} | {one.serving} of {one.size + 1} |"
        )
    head = "| copters | each simulator | RSS of each | rounds late | real-time factor | served |"
    full = [one.size for one in row if one.busy >= FULL]
    words = (
        f"With {full[0]} copters and more the simulators and the daemons together fill the cores of this machine: "
        "what these rows show is what is left to the daemons, and the rows of UAVs that only talk show what they need."
        if full
        else "The simulators leave cores free at every size."
    )
    return "\n".join([head, "|" + "---|" * 6, *said, "", words])


def _lateness(runs: list[Run]) -> str:
    head = (
        "| UAVs | position to belief: p50 | p99 | worst | positions, of them no belief | in time "
        "| action to its success: p50 | p99 | worst "
        "| actions | lag of commd, bridged, agentd at worst | daemons ready, and no core free |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    for one in runs:
        lag = ", ".join(f"{one.lag[kind]:.0f}" for kind in DAEMONS)
        waited = sum(one.use[kind].waited for kind in DAEMONS)
        lines.append(
            f"| {one.size} {_what(one)} | {one.percept.p50:.1f} ms | {one.percept.p99:.1f} ms "
            f"| {one.percept.max:.0f} ms | {one.percept.count + one.unseen}, {one.unseen} | {one.in_time:.1%} "
            f"| {one.asked.p50:.1f} ms | {one.asked.p99:.1f} ms "
            f"| {one.asked.max:.0f} ms | {one.asked.count} | {lag} ms | {waited:.0f} % |"
        )
    return "\n".join(lines)


def _what(one: Run) -> str:
    if one.vehicles == "copters":
        return "copters"
    return "talkers, a bridge each" if one.own_links else "talkers"


def _missed(runs: list[Run]) -> str:
    """Return a table of what was missed anywhere, and in words what was not."""
    kinds = [what for what in runs[0].missed if any(one.missed[what] for one in runs)]
    never = [what for what in runs[0].missed if what not in kinds]
    lines = []
    if kinds:
        lines += [f"| UAVs | {' | '.join(kinds)} |", "|" + "---|" * (len(kinds) + 1)]
        for one in runs:
            if any(one.missed[what] for what in kinds):
                lines.append(f"| {one.size} {_what(one)} | {' | '.join(str(one.missed[what]) for what in kinds)} |")
        lines.append("")
        clean = [f"{one.size} {_what(one)}" for one in runs if not any(one.missed.values())]
        lines += [f"Nothing at all was missed with: {'; '.join(clean)}.", ""] if clean else []
    if never:
        lines.append(f"At no size was there any of: {', '.join(never)}.")
    lines.append(
        "Heartbeats of a bridge, and health records of each daemon, are due each second, and late after "
        f"{BEAT_LATE:g} s; whoever tells or hears nothing at all counts once. In time are positions that "
        "are beliefs before the next one is due, of all that were sent; a position on the heels of the one before is "
        "no belief if the next one replaces it. "
        f"An agent that did not serve its vehicle within {PATIENCE:g} s counts as not served."
    )
    return "\n".join(lines)
