"""What it costs agents that somebody looks at them.

Three measurements: what one look takes of the processor time of a daemon (`looking.bursts`), from which follows
what an agent loses that reasons without a pause; that agent end to end, with somebody who looks on in turns; and three
agents of ordinary vehicles, which mostly sleep.
"""

from __future__ import annotations

import asyncio
import statistics
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks import plots
from benchmarks.traffic import Talker, talk
from benchmarks.looking import bursts
from benchmarks.looking.bursts import (
    CONTROL,
    FLEET,
    LISTENERS,
    LOOKS,
    NOBODY,
    ONLOOKERS,
    RATE,
    STEPS,
    Cost,
    Onlooker,
    Stretch,
    stretch,
)
from benchmarks.parts import Goal, line_of_goals, tell
from benchmarks.results import Origin
from benchmarks.spread import Interval, interval
from benchmarks.watched import Watched, watched
from tests.support.ports import free_port

GOAL: Final = 2.0
"""Per cent of a busy agent's throughput that somebody who looks at it may take."""
LOOKING: Final = ("run", "watch")
PUT_AT_MOST: Final = 4.0
"""Hz at which a mind puts what it has done."""
VIEWS: Final = {"run": ("run",), "watch": ("watch",), "ui": ("watch", "activity")}
"""What the commands that look on do: looks, and what they listen to."""


UNDECIDED: Final = (
    "the interval holds the goal: processor time of so short bursts differs more from one to the next than what a look "
    "takes; tried: neighbours of one round are compared; more rounds make the interval narrower"
)
_SPENT: Final = (
    "a look at a mind is made and encoded in the agent's own process; which part of it takes the most is not known "
    "here; tried: `argosy {view}` asks for no more than it shows, and activity is put at most four times a second"
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
        if cost.key == "activity":  # what was done is put so often at most, however much it is
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
            if cost.key == "activity"
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


__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

_BUSY: Final = """\
n(0). limit(1000000000).
!work(0).
+!work(N) : limit(L) & N < L <- -+n(N); +seen(N mod 300); !leg(N); !!work(N + 1).
+!leg(N) : n(N) <- -seen((N + 150) mod 300).
"""
_ORDINARY: Final = """\
!patrol(0).
+altitude(A) : A > 100 <- .print("too high: ", A).
+battery(_, _, P) : P < 20 <- .print("low: ", P).
+!patrol(N) : altitude(A) & global_pos(X, Y) <-
    +visited(N mod 40, X, Y); -visited((N + 20) mod 40, _, _); .wait(500); !!patrol(N + 1).
+!patrol(N) <- .wait(500); !!patrol(N).
"""


@dataclass(frozen=True)
class Times:
    """How often and how long each thing is measured."""

    looks: int
    """Bursts with each who looks."""
    hearings: int
    """Bursts with each who listens."""
    rounds: int
    """Stretches of the agent that never rests, with somebody and without."""
    ordinary: int
    """Stretches of ordinary agents with each onlooker."""
    settle: float
    """Wall seconds before a stretch: who looks on has joined, who looked on before is gone."""
    seconds: float
    """Wall seconds of a stretch; it lasts until the daemon has told of its health twice in any case."""
    warm_up: int = bursts.WARM_UP
    """Bursts before the first that counts."""


FULL: Final = Times(looks=120, hearings=60, rounds=4, ordinary=3, settle=1.2, seconds=2.4)
QUICK: Final = Times(looks=3, hearings=2, rounds=1, ordinary=1, settle=0.2, seconds=0.4, warm_up=2)


def measure(quick: bool) -> Figures:
    """Measure all three. Raises BenchmarkFailed."""
    times = QUICK if quick else FULL
    tell("what one look takes")
    with daemons("agents:\n  busy: {program: looking.asl}\ninject: true", bursts.PROGRAM) as (endpoint, agentd):
        found = asyncio.run(bursts.costs(endpoint, agentd, (*LOOKS, CONTROL), times.looks, bursts.PAUSE, times.warm_up))
        found += asyncio.run(bursts.costs(endpoint, agentd, LISTENERS, times.hearings, bursts.HEARING, times.warm_up))
    tell("an agent that never rests")
    with daemons("agents:\n  busy: {program: looking.asl}", _BUSY) as (endpoint, _):
        watch, control = _in_turns(endpoint, ["busy"], [LOOKS[1], CONTROL], times.rounds, times)
    lost = [_lost(pairs, lambda one: one.cycles / one.cpu) for pairs in (watch, control)]
    tell("three agents of vehicles")
    shares = _ordinary(ONLOOKERS[:1] if quick else ONLOOKERS, times)
    return Figures(times.rounds, times.ordinary, times.seconds, RATE, found, lost[0], lost[1], *shares)


Pairs = list[tuple[Stretch, tuple[Stretch, Stretch]]]
"""Stretches with somebody, each with its neighbours with nobody."""


def _in_turns(
    endpoint: str, agents: list[str], onlookers: Sequence[Onlooker], rounds: int, times: Times
) -> list[Pairs]:
    """Let each onlooker look on in turn, with nobody in between."""
    found: list[Pairs] = [[] for _ in onlookers]

    async def all_of_them() -> None:
        before = await stretch(endpoint, agents, NOBODY, times.settle, times.seconds)
        for number in range(rounds):
            order = list(zip(onlookers, found, strict=True))
            for onlooker, pairs in order if number % 2 == 0 else reversed(order):
                one = await stretch(endpoint, agents, onlooker, times.settle, times.seconds)
                after = await stretch(endpoint, agents, NOBODY, times.settle, times.seconds)
                pairs.append((one, (before, after)))
                before = after

    asyncio.run(all_of_them())
    return found


def _lost(pairs: Pairs, of: Callable[[Stretch], float]) -> Interval:
    """How many per cent less there was than with nobody."""
    return interval([100 * (1 - of(one) / statistics.mean(map(of, neighbours))) for one, neighbours in pairs])


@contextmanager
def daemons(mission: str, program: str, *more: str) -> Iterator[tuple[str, Watched]]:
    """Run a router, agents and more daemons of a mission; yields the endpoint and agentd. Raises BenchmarkFailed."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        file = folder / "looking.yaml"
        (folder / "looking.asl").write_text(program)
        file.write_text(f"mission: {FLEET}\n{mission}\nrouter: {{endpoint: {endpoint}}}\n")
        state = ("--state", str(folder / "state"))
        stack.enter_context(watched("commd", "-m", "commd", "serve", str(file))).says("commd")
        for name in more:
            stack.enter_context(watched(name, "-m", name, "serve", str(file), *state)).says("serving")
        agentd = stack.enter_context(watched("agentd", "-m", "agentd", "serve", str(file), *state))
        agentd.says("agents=")
        yield endpoint, agentd


def _ordinary(onlookers: Sequence[Onlooker], times: Times) -> tuple[float, list[Share]]:
    """Three agents of three vehicles in flight: what their daemon uses with nobody, and with each onlooker."""
    port, numbers = free_port(), (1, 2, 3)
    agents = "\n".join(f"  agent{n}: {{program: looking.asl, robot: uav{n}}}" for n in numbers)
    link = f"link: 'udpin:127.0.0.1:{port}'"
    robots = "\n".join(f"  uav{n}: {{manifest: arducopter, {link}, sysid: {n}}}" for n in numbers)
    with daemons(f"agents:\n{agents}\nrobots:\n{robots}", _ORDINARY, "bridged") as (endpoint, _):
        talkers = [Talker(n, ("127.0.0.1", port)) for n in numbers]
        lasts = (2 * times.ordinary * len(onlookers) + 1) * (times.seconds + times.settle + 1.0) + 30
        threading.Thread(target=talk, args=(talkers, lasts, 0.0, lambda: None), daemon=True).start()
        if times is not QUICK:  # until the vehicles are known
            asyncio.run(stretch(endpoint, ["agent1"], NOBODY, 4 * times.settle, times.seconds))
        found = _in_turns(endpoint, [f"agent{n}" for n in numbers], onlookers, times.ordinary, times)
    calm = [_share(one) for pairs in found for _, neighbours in pairs for one in neighbours]
    shares = [_more(onlooker, pairs) for onlooker, pairs in zip(onlookers, found, strict=True)]
    return statistics.median(calm), shares


def _more(onlooker: Onlooker, pairs: Pairs) -> Share:
    more = [_share(one) - statistics.mean(map(_share, neighbours)) for one, neighbours in pairs]
    wall = sum(one.lasted for one, _ in pairs)
    got = {
        what: count / wall
        for what, count in sorted(sum((one.got for one, _ in pairs), start=type(pairs[0][0].got)()).items())
    }
    return Share(onlooker.title, got, statistics.median(_share(one) for one, _ in pairs), interval(more))


def _share(one: Stretch) -> float:
    return 100 * one.cpu / one.wall
