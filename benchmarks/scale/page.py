"""The block and the pictures of the part "scale": every sentence with a figure, and every conclusion, is made here."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from benchmarks import fits, plots
from benchmarks.bridge.traffic import POSITIONS, RATES
from benchmarks.results import Origin
from benchmarks.scale.mission import ASK_EVERY
from benchmarks.scale.run import BEAT_LATE, PATIENCE, Run

if TYPE_CHECKING:
    from benchmarks.scale.part import Figures

DAEMONS: Final = ("commd", "bridged", "agentd")
FULL: Final = 95.0
"""Per cent of the machine's cores from which on processes wait for one: what they use then is what they get."""
BOARDS: Final = {"BeagleBone Black": 512.0, "Raspberry Pi 3": 1000.0}
"""MB of memory of boards that the paper flew."""


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
        *_outgrown(talkers, origin),
    ]
    return {"scale": "\n\n".join(part for part in parts if part)}


def _about(row: list[Run]) -> str:
    sizes = ", ".join(str(one.size) for one in row[:-1]) + f" and {row[-1].size}"
    return (
        f"{sizes} UAVs, each a robot with the manifest `arducopter`, and its agent, on one board: one `commd` (the "
        f"router), one `agentd`. A UAV that only talks sends {sum(RATES.values())} MAVLink messages a second, its "
        f"position {POSITIONS} times; every agent asks its vehicle for a parameter {ASK_EVERY / 1000:g} s after it has "
        f"had the last answer, an action with a status and a percept. Each size was looked at for "
        f"{row[-1].seconds:.0f} s at speed 1. Per cent are of one core."
    )


def _costs(row: list[Run]) -> str:
    if not row:
        return ""
    head = (
        "| UAVs | bridges | messages/s | commd | bridged | agentd | daemons | vehicles | cores busy "
        "| PSS of the daemons, MB | of it commd, bridged, agentd | ready after |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    for one in row:
        vehicles = sum(one.use[kind].cpu for kind in ("simulator", "talkers") if kind in one.use)
        each = " | ".join(f"{one.use[kind].cpu:.1f} %" for kind in DAEMONS)
        pss = ", ".join(f"{one.use[kind].pss:.0f}" for kind in DAEMONS)
        lines.append(
            f"| {one.size} | {one.use['bridged'].processes} | {one.messages:.0f} | {each} | {one.cpu():.1f} % "
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
        "| UAVs | position to belief: p50 | p99 | worst | positions, unseen | action to its success: p50 | p99 | worst "
        "| actions | lag of commd, bridged, agentd at worst | daemons ready, and no core free |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    for one in runs:
        lag = ", ".join(f"{one.lag[kind]:.0f}" for kind in DAEMONS)
        waited = sum(one.use[kind].waited for kind in DAEMONS)
        lines.append(
            f"| {one.size} {_what(one)} | {one.percept.p50:.1f} ms | {one.percept.p99:.1f} ms "
            f"| {one.percept.worst:.0f} ms | {one.percept.count}, {one.unseen} "
            f"| {one.asked.p50:.1f} ms | {one.asked.p99:.1f} ms "
            f"| {one.asked.worst:.0f} ms | {one.asked.count} | {lag} ms | {waited:.0f} % |"
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
        f"{BEAT_LATE:g} s. "
        f"An agent that did not serve its vehicle within {PATIENCE:g} s counts as not served."
    )
    return "\n".join(lines)


def easy(row: list[Run]) -> list[Run]:
    """Return the runs by whose cost the growth can be told: those in which cores were left."""
    return [one for one in row if one.busy < FULL]


def _outgrown(row: list[Run], origin: Origin) -> list[str]:
    told = easy(row)
    if len(told) < 2:
        return ["Cores were left at fewer than two sizes: how the cost grows cannot be told from this run."]
    used = ", ".join(str(one.size) for one in told)
    lines = {kind: fits.line([(one.size, one.use[kind].cpu) for one in told]) for kind in DAEMONS}
    lines["the three together"] = fits.line([(one.size, one.cpu()) for one in told])
    memory = fits.line([(one.size, one.pss()) for one in told])
    table = ["| | at rest | each UAV | grows as | fills a core at |", "|---|---|---|---|---|"]
    for name, line in lines.items():
        points = [(one.size, one.use[name].cpu if name in DAEMONS else one.cpu()) for one in told]
        full = f"{line.reaches(100.0):.0f} UAVs" if name in DAEMONS else ""
        table.append(f"| {name} | {max(0.0, line.base):.2f} % | {line.each:.2f} % | {_power(points)} | {full} |")
    points = [(one.size, one.pss()) for one in told]
    table.append(f"| memory (PSS) | {memory.base:.0f} MB | {memory.each:.2f} MB | {_power(points)} | |")
    return [
        f"Lines of least squares through the sizes at which cores were left ({used}):",
        "\n".join(table),
        _conclusion(row, lines, memory, origin.cores),
    ]


def _power(points: fits.Points) -> str:
    return f"size ^ {fits.power(points):.2f}" if len(points) > 2 else "not told by two sizes"


def _conclusion(row: list[Run], lines: dict[str, fits.Line], memory: fits.Line, cores: int) -> str:
    """Say what is outgrown first."""
    single = {kind: lines[kind].reaches(100.0) for kind in DAEMONS}
    first = min(single, key=lambda kind: single[kind])
    board = lines["the three together"].reaches(100.0 * cores)
    late = next((one for one in row if one.percept.p99 > 1000 / POSITIONS), None)
    items = [
        f"**One process**: `{first}` is outgrown first, at {single[first]:.0f} UAVs: one thread does its work, on one "
        "core. " + _remedy(first),
        f"**One router**: `commd` fills a core at {single['commd']:.0f} UAVs; Zenoh's threads may use more than one.",
        f"**One board** of {cores} cores like these: full at {min(board, single[first]):.0f} UAVs"
        + (
            f", when `{first}` is; with its work on more processes at {board:.0f}, when the daemons fill all cores."
            if board > single[first]
            else ", when the daemons together fill all cores."
        ),
        "**Memory**: "
        + ", ".join(f"{size:.0f} MB (a {name}) at {memory.reaches(size):.0f} UAVs" for name, size in BOARDS.items())
        + ", if nothing else were on the board.",
        "**Time**: "
        + (
            f"a position is a belief before the next one comes ({1000 / POSITIONS:.0f} ms) in 99 of 100 cases at every "
            "size measured."
            if late is None
            else f"from {late.size} UAVs on more than 1 of 100 positions are beliefs only after the next one has come "
            f"({1000 / POSITIONS:.0f} ms); p99 is {late.percept.p99:.0f} ms."
        ),
    ]
    return "\n".join(f"- {item}" for item in items)


def _remedy(kind: str) -> str:
    if kind == "bridged":
        return "More links, each with a bridge of its own, use the other cores."
    if kind == "agentd":
        return "Agents on more boards, or in more than one `agentd` of a board, use the other cores."
    return "More boards have more routers."


def pictures(figures: Figures) -> dict[str, str]:
    """Return the pictures of the page."""
    talkers, copters = figures.of("talkers"), figures.of("copters")
    found = {}
    with plots.figure(columns=2) as (made, (cpu, memory)):
        for kind in DAEMONS:
            _curve(cpu, talkers, _used(kind, "cpu"), kind, plots.COLOURS[kind])
            _curve(memory, talkers, _used(kind, "pss"), kind, plots.COLOURS[kind])
        if len(told := easy(talkers)) > 1:
            for kind in DAEMONS:
                line = fits.line([(one.size, one.use[kind].cpu) for one in told])
                sizes = [one.size for one in talkers]
                cpu.plot(sizes, [max(1e-2, line.at(size)) for size in sizes], ":", color=plots.COLOURS[kind])
        cpu.axhline(100.0, color="black", linewidth=0.8, linestyle="--")
        _axes(cpu, "processor time, % of a core")
        _axes(memory, "PSS, MB")
        made.suptitle("UAVs that only talk, one link (dotted: fitted; dashed: one core)", fontsize=9)
        found["scale-cost"] = plots.svg(made)
    with plots.figure(columns=2) as (made, (percept, action)):
        for axes, what in ((percept, "percept"), (action, "asked")):
            for row, style, name in ((talkers, "-", "talkers"), (copters, "--", "copters")):
                for part, colour in (("p50", "#2ca02c"), ("p99", "#ff7f0e"), ("worst", "#d62728")):
                    _curve(
                        axes,
                        row,
                        _late(what, part),
                        f"{part}, {name}",
                        colour,
                        style,
                    )
        _axes(percept, "position to belief, ms")
        _axes(action, "action to its success, ms")
        found["scale-latency"] = plots.svg(made)
    return found


def _used(kind: str, what: str) -> Callable[[Run], float]:
    return lambda one: float(getattr(one.use[kind], what))


def _late(what: str, part: str) -> Callable[[Run], float]:
    return lambda one: float(getattr(getattr(one, what), part))


def _curve(axes: Any, row: list[Run], of: Callable[[Run], float], label: str, colour: str, style: str = "-") -> None:
    points = [(one.size, of(one)) for one in row if of(one) > 0 and math.isfinite(of(one))]
    if points:
        axes.plot(*zip(*points, strict=True), style, marker="o", markersize=3, color=colour, label=label)


def _axes(axes: Any, what: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("UAVs")
    axes.set_ylabel(what)
    axes.legend(fontsize=7)
