"""Part `scale`: the cost, latency and losses of 1 to 100 vehicles with their agents on one router.

Vehicles that only talk (`vehicles`) send the messages of copters that fly a circle and cost next to nothing, so that
the cost is that of the product. Daemons are started as the product starts them: one commd, one bridged for all vehicles
of a link, one agentd for all agents of a board; in a second series each vehicle has a link, and so a bridged, of its
own.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from benchmarks import plots
from benchmarks import spread as fits
from benchmarks.health import DAEMONS
from benchmarks.measurements.fleet import ASK_EVERY, BEAT_LATE, IN_TIME, LATE, PATIENCE, Run, run
from benchmarks.measurements.vehicles import POSITIONS, RATES
from benchmarks.parts import Goal, at_most, progress, row, table
from benchmarks.peers import BEAGLEBONE_MB, PI_MB
from benchmarks.results import Origin

SIZES: Final = (1, 10, 25, 50, 100)
APART: Final = (10, 50)
"""Sizes at which each vehicle also has a bridge of its own."""
QUICK: Final = (1, 5)
SECONDS: Final = 12.0
"""For which each size is observed."""
QUICK_SECONDS: Final = 3.0
GOAL_P99, GOAL_EACH = 60.0, 1.0
"""Milliseconds from a position to its belief; per cent of a core that a vehicle may take of all daemons."""


@dataclass
class Figures:
    """All runs."""

    runs: list[Run] = field(default_factory=list)

    def row(self, *, own_links: bool = False) -> list[Run]:
        """Return a row of sizes, the smallest first."""
        return sorted((one for one in self.runs if one.own_links == own_links), key=lambda one: one.size)


def measure(quick: bool) -> Figures:
    """Measure all sizes. Raises BenchmarkFailed."""
    sizes, apart, seconds = (QUICK, QUICK[-1:], QUICK_SECONDS) if quick else (SIZES, APART, SECONDS)
    figures = Figures()
    for size, own_links in [*((size, False) for size in sizes), *((size, True) for size in apart)]:
        found = run(size, seconds=seconds, own_links=own_links)
        own = ", a bridge for each" if own_links else ""
        progress(f"{size}{own}: {found.serving} served, {found.cpu():.0f} % of a core, p99 {found.percept.p99:.0f} ms")
        figures.runs.append(found)
    return figures


def probe(quick: bool) -> dict[str, float]:
    """Return what a quarter of the vehicles costs, and how late all are: less is better."""
    found: dict[str, float] = {}
    for size in QUICK if quick else (25, SIZES[-1]):
        one = run(size, seconds=QUICK_SECONDS if quick else SECONDS)
        found |= {f"each of {size} vehicles, {kind} (% of a core)": one.use[kind].cpu / size for kind in DAEMONS}
        found[f"memory of all daemons, {size} vehicles (MB)"] = one.pss()
        found[f"position to belief, {size} vehicles, p99 (ms)"] = one.percept.p99
        found[f"positions of {size} vehicles that were no belief in time, and 1 (%)"] = 101 - 100 * one.in_time
        found[f"datagrams of {size} vehicles that were lost, and 1"] = (
            1 + one.missed["datagrams lost before the bridge"]
        )
    return found


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked: that the largest fleet is served in time, and costs no more than in proportion."""
    row = figures.row()
    largest = row[-1]
    missed = sum(largest.missed.values())
    found = [
        Goal(
            f"{largest.size} UAVs that only talk, with their agents, on one router: all served, no deadline missed",
            f"{largest.size}, 0 missed",
            f"{largest.serving}, {missed} missed",
            largest.serving == largest.size and not missed,
            _why(largest),
        ),
        Goal(
            f"positions of {largest.size} UAVs that only talk: beliefs before the next ({LATE:g} ms), of all sent",
            f"{IN_TIME:.0%}",
            f"{largest.in_time:.1%} (p99 of those that came: {largest.percept.p99:.0f} ms)",
            largest.in_time >= IN_TIME,
            _why(largest),
        ),
    ]
    lost = largest.missed.get("datagrams lost before the bridge", 0)
    title = f"positions of {largest.size} UAVs that only talk: datagrams lost, p99 from position to belief"
    found.append(
        Goal(
            title,
            f"0, {GOAL_P99:g} ms",
            f"{lost:,}, {largest.percept.p99:.0f} ms",
            not lost and largest.percept.p99 <= GOAL_P99,
            _why(largest),
        )
    )
    free = easy(row)
    if free:
        size, each = free[-1].size, free[-1].cpu() / free[-1].size
        title = f"processor time of bridged, agentd and commd for each UAV, of {size}, the most with cores left"
        found.append(at_most(title, GOAL_EACH, each, "% of a core", f"{_TRIED}; {_TRIED_GROWTH}", digits=2))
    if len(free) >= fits.SIZES:
        powers = {kind: fits.power([(one.size, one.use[kind].cpu) for one in free]) for kind in DAEMONS}
        worst = max(powers, key=lambda kind: powers[kind].power)
        found.append(
            Goal(
                f"processor time of no daemon grows faster than the fleet ({free[0].size} to {free[-1].size} UAVs)",
                f"size ^ {fits.STEEPEST:g} at most",
                f"{powers[worst]} ({worst}; off by {powers[worst].off:.0%} at worst)",
                powers[worst].power <= fits.STEEPEST,
                _TRIED_GROWTH,
            )
        )
    else:
        few = f"{len(free)} sizes left cores free, and growth needs {fits.SIZES}: it is not known"
        found.append(Goal("processor time of no daemon grows faster than the fleet", "", "", False, few, decided=False))
    return found


def _why(one: Run) -> str:
    """Return why that size was not served in time, as far as its own figures show, and what was tried."""
    what = "; ".join(one.not_served()) or "nothing was late or lost"
    reason = (
        f"the cores were busy for {one.busy:.0f} % of the time"
        if one.busy >= FULL
        else f"the cores were busy for {one.busy:.0f} % of the time, so the reason is not known"
    )
    return f"{what}; {reason}. {_TRIED}"


_TRIED: Final = (
    "Tried: a link remembers as many vehicles as it may have and asks for a receive buffer by their number, keys used "
    "again are declared once, manifests are read once for all robots"
)
_TRIED_GROWTH: Final = (
    "What Zenoh does for a record grows with all that is declared on its session. Tried: keys used again are declared "
    "once, which took most of that away; what grows in the rest is not known"
)


FULL: Final = 95.0
"""Per cent of the machine's cores from which on processes wait for one: what they use then is what they get."""
READY: Final = 70.0
"""Per cent of a core from which on who does its work in one thread is often late: what comes has to wait in line."""
BOARDS: Final = {"BeagleBone Black": BEAGLEBONE_MB, "Raspberry Pi 3": PI_MB}
"""MB of memory of boards that the paper flew."""


def easy(row: list[Run]) -> list[Run]:
    """Return the runs that show the growth of the cost: those in which cores were left."""
    return [one for one in row if one.busy < FULL]


def outgrown(row: list[Run], origin: Origin) -> list[str]:
    """Return at which measured size something was outgrown, how the cost grows, and what that means for more UAVs."""
    free = easy(row)
    found = [_limit(row)]
    if len(free) < fits.SIZES:
        return [*found, f"Cores were left at fewer than {fits.SIZES} sizes: how the cost grows is not known."]
    growths = {name: fits.power(_points(free, name)) for name in (*DAEMONS, ALL_DAEMONS, MEMORY)}
    sizes = ", ".join(str(one.size) for one in free)
    return [
        *found,
        f"By least squares through the sizes at which cores were left ({sizes}); off: by how much the power differs "
        "from what was measured, at worst:",
        "\n".join(table("| | grows as | off |", (f"| {k} | {one} | {one.off:.0%} |" for k, one in growths.items()))),
        _beyond(growths, row[-1].size, origin.cores),
    ]


def _limit(row: list[Run]) -> str:
    sizes = f"{', '.join(str(one.size) for one in row[:-1])} and {row[-1].size}"
    first = next((one for one in row if one.not_served()), None)
    if first is None:
        return (
            f"**As measured: nothing is outgrown up to {row[-1].size} UAVs** on one link (sizes: {sizes}): all were "
            f"served, no deadline was missed, and {IN_TIME:.0%} of the positions were beliefs before the next one "
            f"was due ({1000 / POSITIONS:.0f} ms)."
        )
    return (
        f"**As measured: this machine is outgrown at {first.size} UAVs** on one link, the smallest of the sizes "
        f"{sizes} that did not get everything in time: {'; '.join(first.not_served())}. {first.busy:.0f} % of the "
        "cores were busy then."
    )


ALL_DAEMONS: Final = "the three together"
MEMORY: Final = "memory (PSS)"


def _points(runs: list[Run], name: str) -> list[tuple[float, float]]:
    """Return what a daemon, all of them, or memory cost at each size."""
    return [
        (one.size, one.use[name].cpu if name in DAEMONS else one.pss() if name == MEMORY else one.cpu()) for one in runs
    ]


def _beyond(growths: dict[str, fits.Growth], largest: int, cores: int) -> str:
    """Return what would be outgrown first with more UAVs, by the fits."""

    def size(name: str, cost: float) -> str:
        reached = growths[name].reaches(cost)
        if reached == float("inf"):
            return "no size: it does not grow"
        return f"{reached:.0f} UAVs" if reached <= largest else f"about {reached:.0f} UAVs by the fit, not measured"

    first = min(DAEMONS, key=lambda kind: growths[kind].reaches(READY))
    memory = ", ".join(f"{mb:.0f} MB (a {name}) at {size(MEMORY, mb)}" for name, mb in BOARDS.items())
    items = [
        f"**One process**: `{first}` is the first to need {READY:g} % of a core, at {size(first, READY)}: one thread "
        f"does its work, and input queues from there on. {_REMEDY[first]}",
        f"**One router**: `commd` needs {READY:g} % of a core, all its threads together, at {size('commd', READY)}.",
        f"**One board** of {cores} cores like these: the three daemons together need {READY:g} % of them at "
        f"{size(ALL_DAEMONS, READY * cores)}.",
        f"**Memory**: {memory}, if nothing else were on the board.",
    ]
    return "\n".join(f"- {item}" for item in items)


_REMEDY: Final = {
    "bridged": "More links, each with a bridge of its own, use the other cores.",
    "agentd": "Agents on more boards, or in more than one `agentd` of a board, use the other cores.",
    "commd": "More boards have more routers.",
}


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of docs/measurements/scaling.md."""
    shared, apart = figures.row(), figures.row(own_links=True)
    parts = [
        origin.line(),
        _sizes(shared),
        "### What it costs",
        "All on one link and so in one bridge, as robots are that share a link:",
        _costs(shared),
        "The same, each on a link of its own, and so with a bridge of its own:",
        _costs(apart),
        "![processor time and memory by the number of UAVs](figures/scale-cost.svg)",
        "### How late it is",
        _lateness([*shared, *apart]),
        "### What is missed",
        _missed([*shared, *apart]),
        "### What is outgrown, and when",
        *outgrown(shared, origin),
    ]
    return {"scale": "\n\n".join(parts)}


def _sizes(row: list[Run]) -> str:
    sizes = ", ".join(str(one.size) for one in row[:-1]) + f" and {row[-1].size}"
    return (
        f"{sizes} UAVs, each a robot with the manifest `copter`, and its agent, on one board: one `commd` (the "
        f"router), one `agentd`. A UAV that only talks flies a circle and sends {sum(RATES.values())} MAVLink messages "
        f"a second, its position {POSITIONS} times. Every agent asks its vehicle for a parameter "
        f"{ASK_EVERY / 1000:g} s after it has had the last answer: an action with a status and a percept. Each size "
        f"was looked at for {row[-1].seconds:.0f} s at speed 1. Per cent are of one core."
    )


def _costs(runs: list[Run]) -> str:
    head = (
        "| UAVs | bridges | messages/s | percepts/s of a UAV | commd | bridged | agentd | daemons "
        "| vehicles | cores busy | PSS of the daemons, MB | of it commd, bridged, agentd | ready after |"
    )
    rows = []
    for one in runs:
        rates = f"{one.messages:.0f}", f"{one.percepts / one.size:.1f}"
        busy = (one.use[kind].cpu for kind in DAEMONS)
        daemons = (f"{cpu:.1f} %" for cpu in (*busy, one.cpu()))
        rest = f"{one.use['talkers'].cpu:.0f} %", f"{one.busy:.0f} %", f"{one.pss():.0f}"
        pss = ", ".join(f"{one.use[kind].pss:.0f}" for kind in DAEMONS)
        rows.append(row(one.size, one.use["bridged"].processes, *rates, *daemons, *rest, pss, f"{one.ready:.1f} s"))
    return "\n".join(table(head, rows))


def _lateness(runs: list[Run]) -> str:
    head = (
        "| UAVs | position to belief: p50 | p99 | worst | positions, of them no belief | in time "
        "| action to its success: p50 | p99 | worst | actions |"
    )
    rows = []
    for one in runs:
        percept, asked = (
            (f"{took.p50:.1f} ms", f"{took.p99:.1f} ms", f"{took.max:.0f} ms") for took in (one.percept, one.asked)
        )
        positions = f"{one.percept.count + one.unseen}, {one.unseen}", f"{one.in_time:.1%}"
        rows.append(row(_what(one), *percept, *positions, *asked, one.asked.count))
    return "\n".join(table(head, rows))


def _what(one: Run) -> str:
    return f"{one.size}, a bridge each" if one.own_links else str(one.size)


def _missed(runs: list[Run]) -> str:
    """Return a table of what was missed anywhere, and in words what was not."""
    kinds = [what for what in runs[0].missed if any(one.missed[what] for one in runs)]
    never = [what for what in runs[0].missed if what not in kinds]
    lines = []
    if kinds:
        late = [one for one in runs if any(one.missed[what] for what in kinds)]
        rows = (row(_what(one), *(one.missed[what] for what in kinds)) for one in late)
        lines += [*table(row("UAVs", *kinds), rows), ""]
        clean = [_what(one) for one in runs if not any(one.missed.values())]
        lines += [f"Nothing at all was missed with so many UAVs: {'; '.join(clean)}.", ""] if clean else []
    if never:
        lines.append(f"At no size was there any of: {', '.join(never)}.")
    lines.append(
        "Heartbeats of a bridge, and health records of each daemon, are due each second, and late after "
        f"{BEAT_LATE:g} s; one without any counts once. In time are positions that "
        "are beliefs before the next one is due, of all that were sent; a position on the heels of the one before is "
        "no belief if the next one replaces it. "
        f"An agent that did not serve its vehicle within {PATIENCE:g} s counts as not served."
    )
    return "\n".join(lines)


def pictures(figures: Figures) -> dict[str, str]:
    """Draw processor time and memory of the daemons by the number of vehicles."""
    row = figures.row()
    with plots.figure(columns=2) as (made, (cpu, memory)):
        sizes = [one.size for one in row]
        for kind in DAEMONS:
            style = {"marker": "o", "markersize": 3, "color": plots.COLOURS[kind], "label": kind}
            cpu.plot(sizes, [one.use[kind].cpu for one in row], **style)
            memory.plot(sizes, [one.use[kind].pss for one in row], **style)
        cpu.axhline(100.0, color="black", linewidth=0.8, linestyle="--")
        _axes(cpu, "processor time, % of a core")
        _axes(memory, "PSS, MB")
        made.suptitle("UAVs that only talk, one link (dashed: one core)", fontsize=9)
        return {"scale-cost": plots.svg(made)}


def _axes(axes: Any, what: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("UAVs")
    axes.set_ylabel(what)
    axes.legend(fontsize=7, handlelength=3.5)
