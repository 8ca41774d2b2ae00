"""Part "crowd": 1 to 1,000 agents in one agentd, with all that agents have: mail on disk, checkpoints, health.

Agents sit in a ring: each asks the one behind it for a belief, and waits for the answer. Every question and every
answer is a message through the board's commd, written down by sender, board and receiver.
"""

from __future__ import annotations

import asyncio
import os
import re
import statistics
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from benchmarks.mail.boards import FLEET, Member, member, until
from benchmarks.processes import BenchmarkFailed, memory
from benchmarks.watched import Watched, watched
from tests.support.ports import free_port

SIZES: Final = (1, 10, 100, 300, 1000)
QUICK: Final = (1, 20)
QUESTIONS: Final = 6_000
"""That all agents together ask as fast as they can, at least `EACH_LEAST` each."""
EACH_LEAST, EACH_MOST = 5, 200
PACE: Final = 10.0
"""Seconds from one question of an agent to its next in a crowd that is at its ease."""
AT_EASE: Final = float(os.environ.get("EASE", "20"))
"""Seconds over which that is measured."""
IDLE: Final = 5.0
"""Seconds over which a crowd that does nothing is measured."""
STARTING: Final = 120.0
"""Seconds that an agentd has to start."""
SETTLE: Final = 3.0
_BOARD: Final = "b1"
_PROGRAM: Final = """\
secret(42).
+ask(N, Pause)[source(S)] <- -ask(N, Pause)[source(S)]; .random(R); .wait(R * Pause); !ask(N, Pause, []).
+!ask(0, _, Took) <- .print("took ", Took).
+!ask(N, Pause, Took) : behind(A) <-
    .nano_time(Begun); .send(A, askOne, secret(_), secret(_)); .nano_time(Ended);
    .wait(Pause); !ask(N - 1, Pause, [(Ended - Begun) / 1000000|Took]).
"""
_TOOK: Final = re.compile(r"\[(\w+)\] took \[(.*)\]")


@dataclass
class Loaded:
    """A crowd under a load."""

    rate: float
    """Messages a second, from the first question to the last answer."""
    p50: float
    p99: float
    worst: float
    """Milliseconds from a question to its answer."""
    median_agent: float
    slowest_agent: float
    """Milliseconds that a question of one agent took in the mean: of the median agent, and of the slowest."""
    agentd: float
    commd: float
    """Per cent of a core."""

    @property
    def fairness(self) -> float:
        """The slowest agent against the median one."""
        return self.slowest_agent / self.median_agent


@dataclass
class Crowd:
    """An agentd with so many agents, and the commd of its board."""

    agents: int
    start: float
    """Seconds from the start of the process until it serves."""
    cpu_start: float
    """Seconds of processor time for that."""
    rss: float
    commd_rss: float
    """MB, at rest."""
    idle: float
    commd_idle: float
    """Per cent of a core at rest."""
    stop: float
    """Seconds from SIGTERM to the end of the process."""
    hurried: Loaded | None = None
    eased: Loaded | None = None


@dataclass
class Figures:
    """What the part measures."""

    crowds: list[Crowd] = field(default_factory=list)
    fsync: float = 0.0
    """Milliseconds of one on this disk."""
    pace: float = PACE


def measure(quick: bool) -> Figures:
    """Start one crowd after the other. Raises BenchmarkFailed."""
    figures = Figures(fsync=_fsync())
    for agents in QUICK if quick else SIZES:
        with tempfile.TemporaryDirectory() as folder:
            figures.crowds.append(asyncio.run(crowd(Path(folder), agents, 2.0 if quick else IDLE)))
    return figures


async def crowd(folder: Path, agents: int, idle: float, at_ease: float = AT_EASE) -> Crowd:
    """Measure one crowd."""
    with ExitStack() as stack:
        mission = _mission(folder, agents)
        router = f"tcp/127.0.0.1:{free_port()}"
        where = ("serve", str(mission), "--router", router, "--state", str(folder / "state"), "--board", _BOARD)
        commd = stack.enter_context(watched("commd", "-m", "commd", *where))
        await asyncio.to_thread(commd.says, "router board=")
        begun = time.monotonic()
        agentd = stack.enter_context(watched("agentd", "-m", "agentd", *where))
        started = await until(lambda: _serves(agentd), "agentd serves", STARTING)
        found = Crowd(agents, started, agentd.cpu(), 0, 0, 0, 0, 0)
        await asyncio.sleep(SETTLE)
        used, since = (agentd.cpu(), commd.cpu()), time.monotonic()
        await asyncio.sleep(idle)
        passed = time.monotonic() - since
        found.idle, found.commd_idle = (100 * (agentd.cpu() - used[0]) / passed, 100 * (commd.cpu() - used[1]) / passed)
        found.rss, found.commd_rss = memory(agentd.process.pid, "VmRSS"), memory(commd.process.pid, "VmRSS")
        async with member(router, "probe") as probe:
            if agents > 1:
                each = min(EACH_MOST, max(EACH_LEAST, round(QUESTIONS / agents)))
                found.hurried = await _loaded(probe, commd, agentd, agents, each, 0)
                found.eased = await _loaded(probe, commd, agentd, agents, max(1, round(at_ease / PACE)), PACE)
        begun = time.monotonic()
        agentd.process.terminate()
        await until(lambda: agentd.process.poll() is not None, "agentd ends", STARTING)
        found.stop = time.monotonic() - begun
        return found


def _serves(agentd: Watched) -> bool:
    if agentd.process.poll() is not None:
        raise BenchmarkFailed("agentd ended: " + "\n".join(line for _, line in agentd.said[-5:]))
    return any("agents=" in line for _, line in agentd.said)


def _mission(folder: Path, agents: int) -> Path:
    (folder / "asker.asl").write_text(_PROGRAM)
    ring = "\n".join(
        f"  a{one}: {{program: asker.asl, board: {_BOARD}, beliefs: [behind(a{(one + 1) % agents})]}}"
        for one in range(agents)
    )
    file = folder / "crowd.yaml"
    file.write_text(
        f"mission: {FLEET}\nboards: {{{_BOARD}: {{}}}}\nagents:\n{ring}\nclients: {{probe: {{board: {_BOARD}}}}}\n"
    )
    return file


async def _loaded(probe: Member, commd: Watched, agentd: Watched, agents: int, each: int, pause: float) -> Loaded:
    """Let each agent ask so many questions, with so many seconds between them."""
    said = len(agentd.said)
    used, begun = (agentd.cpu(), commd.cpu()), time.monotonic()
    names = [f"a{one}" for one in range(agents)]
    for first in range(0, agents, 200):
        await probe.post(names[first : first + 200], f"ask({each}, {1000 * pause:g})")
    took: dict[str, list[float]] = {}
    seen = said

    def all_answered() -> bool:
        nonlocal seen
        while seen < len(agentd.said):
            if (match := _TOOK.search(agentd.said[seen][1])) is not None:
                took[match[1]] = [float(one) for one in match[2].split(",")]
            seen += 1
        return len(took) == agents

    await until(all_answered, f"all {agents} agents have their answers; {len(took)} have", 240)
    seconds = time.monotonic() - begun
    values = sorted(one for values in took.values() for one in values)
    means = sorted(statistics.fmean(one) for one in took.values())
    return Loaded(
        2 * len(values) / seconds,
        values[len(values) // 2],
        values[min(len(values) - 1, round(0.99 * len(values)))],
        values[-1],
        statistics.median(means),
        means[-1],
        100 * (agentd.cpu() - used[0]) / seconds,
        100 * (commd.cpu() - used[1]) / seconds,
    )


def _fsync() -> float:
    """Milliseconds of an fsync of 4 kB, the median of 50."""
    with tempfile.NamedTemporaryFile() as file:
        values = []
        for _ in range(50):
            file.write(bytes(4096))
            file.flush()
            begun = time.perf_counter()
            os.fsync(file.fileno())
            values.append(1000 * (time.perf_counter() - begun))
    return statistics.median(values)


if __name__ == "__main__":
    import sys

    for size in map(int, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as folder:
            print(asyncio.run(crowd(Path(folder), size, IDLE)))
