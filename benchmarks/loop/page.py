"""What the decision loop took, as docs/measurements/benchmarks.md tells it, and what is asked of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median
from typing import Final

from benchmarks.loop.flood import Flood
from benchmarks.loop.latency import PAUSE, Turns
from benchmarks.loop.stages import STAGES
from benchmarks.parts import Goal
from benchmarks.plots import COLOURS, figure, svg
from benchmarks.results import Origin
from benchmarks.spread import percentile

GOAL_TIMES, GOAL_RATE = 4.0, 1000.0
_NOTES: Final = f"""\
* The robot is a process on Zenoh keys. The loop goes from the moment before it puts a sample (`ping(N)`) to where the
  plan `+ping(N) <- pong(N); seen(N).` begins with `seen`, after the final status of `pong`. Ways in it: sample to the
  bridge, percept to the agent (two puts), action to the bridge, status back (a query and its reply). A way counts as
  half of its bare exchange. The bare put carries a percept's bytes both ways; the sample is smaller.
* *Times* are percentiles of the loop over those of what the bare exchanges of each turn take together.
* *Next action at the robot* is seen by the robot alone: daemons as they are. *Stamped*: the daemons' mains run with
  functions wrapped that note the time (`benchmarks/loop/stamps.py`).
* There is a pause of {1000 * PAUSE:g} ms between two exchanges: what a decision leaves to be done, as to sync the id
  of its action to the disk, is over when the next begins. *At the heels* is without that pause."""
FIGURES: Final = ((0.5, "p50"), (0.99, "p99"), (1.0, "max"))


@dataclass
class Figures:
    """What one run measured."""

    bytes: dict[str, int]
    kept: Turns
    """An agent that is kept on disk, as agents are if nobody says otherwise."""
    fresh: Turns
    """One that begins anew at each start: no action is written down before it is asked for."""
    stamped: Turns
    """As `kept`, by daemons with stamps."""
    hurried: Turns
    """As `kept`, without a pause between two turns."""
    replaced: list[Flood]
    added: list[Flood]


def times(turns: Turns, part: float = 0.5, *, ways: str = "loop") -> float:
    """Return how often the bare exchanges that the loop contains fit into it, at a percentile.

    The bare ones of a turn are added up before their percentile is taken: the sum of two worst cases would be too kind.
    `ways`: `loop` up to where the plan goes on, two put ways and two of a query; `seen` up to the next action at the
    robot, one more of each; `pong` up to the first action at the robot, three put ways and one of a query.
    """
    puts, asks = {"loop": (1.0, 1.0), "seen": (1.5, 1.5), "pong": (1.5, 0.5)}[ways]
    bare = [puts * put + asks * ask for put, ask in zip(turns.put, turns.ask, strict=True)]
    return percentile(getattr(turns, ways), part) / percentile(bare, part)


def fastest(floods: list[Flood]) -> Flood | None:
    """Return the run of the highest rate at which nothing was lost."""
    return max((one for one in floods if one.kept_up), key=lambda one: one.made, default=None)


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of the figures."""
    made = []
    for what, turns, ways in (
        ("percept → belief → plan → action → status → the plan goes on", figures.stamped, "loop"),
        ("the same and the next action at the robot, daemons as they are", figures.kept, "seen"),
    ):
        ratio = times(turns, ways=ways)
        made.append(
            Goal(
                title=f"{what}, p50",
                wanted=f"< {GOAL_TIMES:g} times the bare exchanges in it, at p50",
                found=f"{ratio:.1f} times (at p99 {times(turns, 0.99, ways=ways):.1f})",
                met=ratio < GOAL_TIMES,
                why=_why(figures),
            )
        )
    for what, floods in (("replaced", figures.replaced), ("added", figures.added)):
        best = fastest(floods)
        rate = 0.0 if best is None else best.made
        made.append(
            Goal(
                title=f"percepts a second that are {what}, for one agent, none lost",
                wanted=f"{GOAL_RATE:,.0f}",
                found=f"{rate:,.0f}",
                met=rate >= GOAL_RATE,
                why=_what_was_lost(floods),
            )
        )
    return made


_TRIED: Final = (
    "tried: keys are declared once, a percept takes one pass of the agent's event loop, the bridge answers the asker "
    "first"
)


def _why(figures: Figures) -> str:
    """Return where the time of a loop that takes too long goes, in words."""
    by = _by_whom(figures)
    largest = max(zip(STAGES, figures.stamped.stages, strict=True), key=lambda one: median(one[1]))[0]
    shares = ", ".join(f"{who} {spent:,.0f} µs" for who, spent in by.items())
    return f"of the loop {shares}; the longest of it: {largest.title}; {_TRIED}"


def _what_was_lost(floods: list[Flood]) -> str:
    """Return what ended the rise of the rate, in words."""
    last = floods[-1]
    if last.kept_up:
        return f"no rate above {last.made:,.0f} a second was tried, and nothing was lost"
    if not last.in_time:
        return f"of {last.rate:,.0f} changes a second the sender here made {last.reached:,.0f}; {_TRIED}"
    lost = ", ".join(f"{name} {value:,.0f}" for name, value in last.lost.items())
    missing = last.changes - last.heard
    if not lost and missing:
        lost = f"{missing:,} events did not come"
    if not lost and last.disorder:
        lost = f"out of order: {last.disorder[0]}"
    late = "the last event never came" if last.behind < 0 else f"the last event came {last.behind:.2f} s late"
    return f"at {last.reached:,.0f} a second: {lost or late}; why just there is not known; {_TRIED}"


def _by_whom(figures: Figures) -> dict[str, float]:
    """Return the microseconds of the loop by daemon and bus: sums of the stages' medians."""
    by: dict[str, float] = {}
    for stage, spent in zip(STAGES, figures.stamped.stages, strict=True):
        by[stage.who] = by.get(stage.who, 0.0) + median(spent)
    return by


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the block of the page."""
    return {"loop": "\n".join([origin.line(), "", *_latencies(figures), "", *_stages(figures), "", *_rates(figures)])}


def _latencies(figures: Figures) -> Iterator[str]:
    said = figures.bytes
    yield (
        f"{len(figures.kept.put)} turns each; µs; percepts of {said['percept']} bytes, actions of {said['action']}, "
        f"statuses of {said['status']}. *Bare* are exchanges of the same sizes between two Python processes with a "
        "session each, through the same router, in turn with the loop: one waits for what comes, the other answers in "
        "its callback, as the daemons hear."
    )
    yield ""
    yield "| | bare exchanges in it | p50 | p99 | max | times the bare ones: p50 | p99 |"
    yield "|---|---|---|---|---|---|---|"
    yield f"| bare: a put, and put back | | {_row(figures.kept.put)} | | |"
    yield f"| bare: a query and its reply | | {_row(figures.kept.ask)} | | |"
    for what, turns, ways in (
        ("percept → action at the robot", figures.kept, "pong"),
        ("percept → action → status → next action at the robot", figures.kept, "seen"),
        ("the same, agent with `on_restart: fresh`", figures.fresh, "seen"),
        ("the same, one turn at the heels of the other", figures.hurried, "seen"),
        ("percept → action → status → the plan goes on (stamped)", figures.stamped, "loop"),
        ("percept → ... → next action at the robot (stamped)", figures.stamped, "seen"),
    ):
        contains = {"loop": "1 put, 1 query", "seen": "1.5 puts, 1.5 queries", "pong": "1.5 puts, 0.5 queries"}[ways]
        ratios = f"{times(turns, 0.5, ways=ways):.1f} | {times(turns, 0.99, ways=ways):.1f}"
        yield f"| {what} | {contains} | {_row(getattr(turns, ways))} | {ratios} |"
    yield ""
    yield _NOTES
    yield (
        f"* Of {len(figures.stamped.put)} stamped loops {len(figures.stamped.loop)} have all stamps; the others are "
        "left out."
    )


def _row(values: list[float]) -> str:
    return " | ".join(f"{percentile(values, part):,.0f}" for part, _ in FIGURES)


def _stages(figures: Figures) -> Iterator[str]:
    stages = figures.stamped.stages
    whole = sum(median(spent) for spent in stages)
    yield "![where the time of the loop goes](figures/loop.svg)"
    yield ""
    yield "| where the time goes | in | p50, µs | p99, µs | part |"
    yield "|---|---|---|---|---|"
    for stage, spent in zip(STAGES, stages, strict=True):
        part = 100 * median(spent) / whole
        yield f"| {stage.title} | {stage.who} | {median(spent):,.0f} | {percentile(spent, 0.99):,.0f} | {part:.0f} % |"
    parts = ", ".join(f"{who} {100 * spent / whole:.0f} %" for who, spent in _by_whom(figures).items())
    yield ""
    yield f"In all: {parts}."


def _rates(figures: Figures) -> Iterator[str]:
    heads = ("a second", "changes", "events", "behind, s", "bridge, % of a core", "agent", "router", "lost")
    yield f"| percepts for one agent | {' | '.join(heads)} |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for what, floods in (("replaced", figures.replaced), ("added, each for 0.2 s", figures.added)):
        for one in floods:
            behind = "never done" if one.behind < 0 else f"{one.behind:.2f}"
            lost = ", ".join(f"{name} {value:,.0f}" for name, value in one.lost.items()) or "nothing"
            cpu = " | ".join(f"{one.cpu[who]:.0f}" for who in ("bridged", "agentd", "commd"))
            yield f"| {what} | {one.reached:,.0f} | {one.changes:,} | {one.heard:,} | {behind} | {cpu} | {lost} |"
    yield ""
    yield (
        "The program itself judges the order: each event must be the one after the last. A rate is raised until "
        "changes are lost, the last event comes more than a second late, or the sender, which is a Python program on "
        "the same cores, makes less than it should. Per cents are of the time up to the last event."
    )


def in_short(figures: Figures) -> list[str]:
    """Return the row of README."""
    loop = median(figures.stamped.loop) / 1000
    return [
        "| from a percept to the status of the action that it leads to, through all daemons, p50 "
        f"| {loop:.2f} ms, {times(figures.stamped):.1f} times the bare Zenoh exchanges in it | |"
    ]


def pictures(figures: Figures) -> dict[str, str]:
    """Return the plot of where the time goes."""
    stages = figures.stamped.stages
    colours = {"bus": COLOURS["paper"], "bridged": COLOURS["bridged"], "agentd": COLOURS["agentd"]}
    with figure(height=4.2) as (made, axes):
        begun, seen = 0.0, set[str]()
        for place, (stage, spent) in enumerate(zip(STAGES, stages, strict=True)):
            label = None if stage.who in seen else stage.who
            axes.barh(place, median(spent), left=begun, color=colours[stage.who], label=label)
            seen.add(stage.who)
            begun += median(spent)
        bare = median(figures.stamped.put) + median(figures.stamped.ask)
        axes.axvline(bare, color="black", linewidth=0.8, linestyle=":", label="the bare exchanges")
        axes.axvline(
            GOAL_TIMES * bare, color="black", linewidth=0.8, linestyle="--", label=f"{GOAL_TIMES:g} times those"
        )
        axes.set_yticks(range(len(STAGES)), [stage.title for stage in STAGES])
        axes.invert_yaxis()
        axes.set_xlabel("µs since the robot put its sample, medians")
        axes.legend(loc="lower left", fontsize=8)
        return {"loop": svg(made)}
