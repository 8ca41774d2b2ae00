"""What it costs an agent that somebody looks at it; writes the figures of docs/looking.md.

Stretches with somebody who looks on stand between stretches with nobody, in one run of one daemon: a ratio is that of a
stretch to the mean of its two neighbours. A busy agent reasons without a pause; its throughput is counted in cycles,
per second of processor time of its daemon (which other work on the machine hardly changes) and per second. Three agents
of ordinary vehicles mostly sleep: there it is the processor time itself that counts.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import platform
import statistics
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

from agentd.look import Look
from agentd.viewer import SHOWN_AGAIN
from benchmarks.one_look import one_look
from benchmarks.onlookers import FLEET, NOBODY, ONLOOKERS, Onlooker, Stretch, stretch
from benchmarks.processes import BenchmarkFailed
from benchmarks.traffic import Talker, talk
from benchmarks.watched import watched
from tests.support.ports import free_port

GOAL: Final = 2.0
"""Per cent of a busy agent's throughput that a look at it may take."""
SETTLE: Final = 1.2
"""Wall seconds before a stretch: who looks on has joined, who looked on before is gone."""
VIEWS: Final = ("run", "watch", "ui")
"""For these the goal holds."""
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"

_BUSY: Final = """\
n(0). limit(1000000000).
!work(0).
+!work(N) : limit(L) & N < L <- -+n(N); +seen(N mod 300); !leg(N); !!work(N + 1).
+!leg(N) : N mod 1000 == 0 <- .print("leg ", N).
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


@dataclass
class Figures:
    """What was measured of one onlooker: a value per stretch, and that of its neighbours with nobody."""

    onlooker: Onlooker
    pairs: list[tuple[Stretch, tuple[Stretch, Stretch]]] = field(default_factory=list)

    def cost(self, of: Callable[[Stretch], float]) -> list[float]:
        """How many per cent less there was than with nobody, per stretch."""
        return [100 * (1 - of(one) / statistics.mean(map(of, neighbours))) for one, neighbours in self.pairs]

    def looks(self) -> str:
        """What the onlooker got, in words."""
        wall = sum(one.lasted for one, _ in self.pairs)
        got = sum((one.got for one, _ in self.pairs), start=type(self.pairs[0][0].got)())
        if got["errors"]:
            raise BenchmarkFailed(f"{got['errors']} looks of {self.onlooker.key} were not answered")
        return ", ".join(f"{count / wall:.1f} {what}/s" for what, count in sorted(got.items())) or "nothing"


def measured(endpoint: str, agents: list[str], rounds: int, seconds: float) -> list[Figures]:
    """Let each onlooker look on in turn, with nobody in between."""
    found = [Figures(onlooker) for onlooker in ONLOOKERS]

    async def all_of_them() -> None:
        before = await stretch(endpoint, agents, NOBODY, SETTLE, seconds)
        for number in range(rounds):
            for figures in found if number % 2 == 0 else reversed(found):
                one = await stretch(endpoint, agents, figures.onlooker, SETTLE, seconds)
                after = await stretch(endpoint, agents, NOBODY, SETTLE, seconds)
                figures.pairs.append((one, (before, after)))
                before = after

    asyncio.run(all_of_them())
    return found


@contextmanager
def daemons(mission: str, program: str, *more: str) -> Iterator[str]:
    """Run a router, agents and more daemons of a mission; yields the endpoint. Raises BenchmarkFailed."""
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
        stack.enter_context(watched("agentd", "-m", "agentd", "serve", str(file), *state)).says("agents=")
        yield endpoint


def busy(rounds: int, seconds: float) -> list[Figures]:
    """One agent that reasons without a pause."""
    with daemons("agents:\n  busy: {program: looking.asl}", _BUSY) as endpoint:
        return measured(endpoint, ["busy"], rounds, seconds)


def ordinary(rounds: int, seconds: float) -> list[Figures]:
    """Three agents of three vehicles in flight."""
    port, numbers = free_port(), (1, 2, 3)
    agents = "\n".join(f"  agent{n}: {{program: looking.asl, robot: uav{n}}}" for n in numbers)
    link = f"link: 'udpin:127.0.0.1:{port}'"
    robots = "\n".join(f"  uav{n}: {{manifest: arducopter, {link}, sysid: {n}}}" for n in numbers)
    with daemons(f"agents:\n{agents}\nrobots:\n{robots}", _ORDINARY, "bridged") as endpoint:
        talkers = [Talker(n, ("127.0.0.1", port)) for n in numbers]
        lasts = (2 * rounds * len(ONLOOKERS) + 1) * (seconds + SETTLE + 1.0) + 30
        threading.Thread(target=talk, args=(talkers, lasts, 0.0, lambda: None), daemon=True).start()
        asyncio.run(stretch(endpoint, ["agent1"], NOBODY, 5.0, 2.5))
        return measured(endpoint, [f"agent{n}" for n in numbers], rounds, seconds)


def _spread(values: list[float], unit: str = "%") -> str:
    """The median, and in brackets the middle half."""
    low, _, high = statistics.quantiles(values, n=4)
    return f"{statistics.median(values):.1f} {unit} ({low:.1f} to {high:.1f})"


def _per_cpu(one: Stretch) -> float:
    return one.cycles / one.cpu


def _per_second(one: Stretch) -> float:
    return one.cycles / one.wall


def _share(one: Stretch) -> float:
    return 100 * one.cpu / one.wall


def _one_look(onlooker: Onlooker) -> str:
    """What a look takes, and what that is at its rate."""
    parameters = dict(part.split("=") for part in (onlooker.selector or "").lstrip("?").split(";") if part)
    taken = one_look(_BUSY, Look.of(parameters))
    return f"{taken:.1f} ms: {taken / 10 * min(onlooker.rate, 1 / SHOWN_AGAIN):.1f} % at {onlooker.rate:g} Hz"


def report(busy_figures: list[Figures], ordinary_figures: list[Figures], seconds: float) -> str:
    """The figures as tables."""
    versions = f"Python {platform.python_version()}, eclipse-zenoh {version('eclipse-zenoh')}"
    machine = f"{os.cpu_count()} cores of {platform.machine()}"
    count = len(busy_figures[0].pairs)
    alone = [one for figures in busy_figures for _, (one, _) in figures.pairs]
    calm = [one for figures in ordinary_figures for _, (one, _) in figures.pairs]
    lines = [
        f"Measured by `make bench-looking` on {datetime.now(UTC):%Y-%m-%d}: {versions}, {machine};",
        f"{count} stretches of {seconds:g} s each, between some with nobody: medians, in brackets the middle half.",
        "",
        f"A busy agent, with nobody {statistics.median(map(_per_cpu, alone)):,.0f} cycles a second of processor time:",
        "",
        "| who looks on | what it gets | one look takes of the thread that reasons | lost per processor time "
        f"| lost per second | goal: under {GOAL:g} % |",
        "|---|---|---|---|---|---|",
    ]
    for figures in busy_figures:
        cost = figures.cost(_per_cpu)
        goal = ("met" if statistics.median(cost) < GOAL else "missed") if figures.onlooker.key in VIEWS else ""
        look = _one_look(figures.onlooker) if figures.onlooker.selector is not None else ""
        lines.append(
            f"| {figures.onlooker.title} | {figures.looks()} | {look} | {_spread(cost)} "
            f"| {_spread(figures.cost(_per_second))} | {goal} |"
        )
    lines += [
        "",
        "Three agents of three vehicles in one agentd, all of them looked at. With nobody it takes "
        f"{_spread(list(map(_share, calm)))} of a core:",
        "",
        "| who looks on | what it gets | agentd, % of a core | more than with nobody |",
        "|---|---|---|---|",
    ]
    for figures in ordinary_figures:
        shares = [_share(one) for one, _ in figures.pairs]
        more = [_share(one) - statistics.mean(map(_share, neighbours)) for one, neighbours in figures.pairs]
        lines.append(
            f"| {figures.onlooker.title} | {figures.looks()} | {_spread(shares)} | {_spread(more, 'points')} |"
        )
    return "\n".join(lines)


def main() -> int:
    """Measure and write. Returns the exit code: 1 if the goal is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.looking", description=__doc__)
    parser.add_argument("--rounds", type=int, default=10, help="stretches of each onlooker (with three agents: half)")
    parser.add_argument("--seconds", type=float, default=3.2, help="wall seconds of a stretch")
    parser.add_argument("--out", type=Path, help="page whose figures are replaced")
    args = parser.parse_args()
    try:
        found = busy(args.rounds, args.seconds), ordinary(max(2, args.rounds // 2), args.seconds)
        text = report(*found, args.seconds)
    except BenchmarkFailed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(text)
    if args.out is not None:
        before, _, rest = args.out.read_text(encoding="utf-8").partition(BEGIN)
        args.out.write_text(f"{before}{BEGIN}\n{text}\n{END}{rest.partition(END)[2]}", encoding="utf-8")
    views = [figures for figures in found[0] if figures.onlooker.key in VIEWS]
    return 0 if all(statistics.median(figures.cost(_per_cpu)) < GOAL for figures in views) else 1


if __name__ == "__main__":
    sys.exit(main())
