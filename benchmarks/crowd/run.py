"""One crowd: an agentd with so many agents, the commd of its board, and what both take at rest and under load."""

from __future__ import annotations

import asyncio
import re
import statistics
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.mail.boards import FLEET, Member, member, until
from benchmarks.processes import BenchmarkFailed, memory
from benchmarks.spread import NOTHING, Spread, spread
from benchmarks.watched import Watched, watched
from tests.support.ports import free_port

STARTING: Final = 120.0
"""Seconds that an agentd has to start, and to end."""
ANSWERING: Final = 200.0
"""Seconds that all agents have to get their answers."""
SETTLE: Final = 3.0
SETTLE_EACH: Final = 0.01
"""Seconds before anything counts, and for each agent: services of a former life are forgotten meanwhile."""
AT_ONCE: Final = 200
"""Agents that are told in one batch to begin."""
BOARD: Final = "b1"
SERVES: Final = "agents="
"""What an agentd says when all its agents are there."""
_PROGRAM: Final = """\
secret(42).
+ask(N, Pause)[source(S)] <- -ask(N, Pause)[source(S)]; .random(R); .wait(R * Pause); !ask(N, []).
+!ask(0, Took) <- .print("took ", Took).
+!ask(N, Took) : behind(A) <-
    .nano_time(Begun); .send(A, askOne, secret(_), secret(_), 180000); .nano_time(Ended);
    !ask(N - 1, [(Ended - Begun) / 1000000|Took]).
"""
_TOOK: Final = re.compile(r"\[(\w+)\] took \[(.*)\]")


@dataclass
class Loaded:
    """A crowd under a load."""

    asked: int
    """Questions of all agents together."""
    answered: int
    """Those of agents that had all their answers within `ANSWERING`."""
    rate: float
    """Messages a second, from the first word to an agent that it may ask to the last answer."""
    took: Spread
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
        return self.slowest_agent / self.median_agent if self.median_agent else 0.0

    @property
    def all_answered(self) -> bool:
        """Whether no question was left."""
        return self.answered == self.asked


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
    """Not measured of a crowd that was still at its questions of before."""


async def crowd(folder: Path, agents: int, idle: float, each: int, pace: float) -> Crowd:
    """Measure one crowd: each agent asks `each` questions as fast as it can, and one within `pace` seconds.

    Raises BenchmarkFailed.
    """
    with ExitStack() as stack:
        mission = mission_of(folder, agents)
        router = f"tcp/127.0.0.1:{free_port()}"
        where = ("serve", str(mission), "--router", router, "--state", str(folder / "state"), "--board", BOARD)
        commd = stack.enter_context(watched("commd", "-m", "commd", *where))
        await asyncio.to_thread(commd.says, "router board=")
        begun = time.monotonic()
        agentd = stack.enter_context(watched("agentd", "-m", "agentd", *where))
        await asyncio.to_thread(agentd.says, SERVES, STARTING)
        started = time.monotonic() - begun
        found = Crowd(agents, started, agentd.cpu(), 0, 0, 0, 0, 0)
        await asyncio.sleep(SETTLE + SETTLE_EACH * agents)
        used, since = (agentd.cpu(), commd.cpu()), time.monotonic()
        await asyncio.sleep(idle)
        passed = time.monotonic() - since
        found.idle, found.commd_idle = (100 * (agentd.cpu() - used[0]) / passed, 100 * (commd.cpu() - used[1]) / passed)
        found.rss, found.commd_rss = memory(agentd.process.pid, "VmRSS"), memory(commd.process.pid, "VmRSS")
        async with member(router, "probe") as probe:
            if agents > 1:
                found.hurried = await _loaded(probe, commd, agentd, agents, each, 0)
            if found.hurried is not None and found.hurried.all_answered:
                found.eased = await _loaded(probe, commd, agentd, agents, 1, pace)
        begun = time.monotonic()
        agentd.process.terminate()
        await until(lambda: agentd.process.poll() is not None, "agentd ends", STARTING)
        found.stop = time.monotonic() - begun
        return found


def mission_of(folder: Path, agents: int) -> Path:
    """Write the mission and its program to a folder. Returns its file."""
    (folder / "asker.asl").write_text(_PROGRAM)
    ring = "\n".join(
        f"  a{one}: {{program: asker.asl, board: {BOARD}, beliefs: [behind(a{(one + 1) % agents})]}}"
        for one in range(agents)
    )
    file = folder / "crowd.yaml"
    file.write_text(
        f"mission: {FLEET}\nboards: {{{BOARD}: {{}}}}\nagents:\n{ring}\nclients: {{probe: {{board: {BOARD}}}}}\n"
    )
    return file


async def _loaded(probe: Member, commd: Watched, agentd: Watched, agents: int, each: int, pause: float) -> Loaded:
    """Let each agent ask so many questions, with so many seconds between them."""
    said = len(agentd.said)
    used, begun = (agentd.cpu(), commd.cpu()), time.monotonic()
    names = [f"a{one}" for one in range(agents)]
    for first in range(0, agents, AT_ONCE):
        await probe.post(names[first : first + AT_ONCE], f"ask({each}, {1000 * pause:g})")
    took: dict[str, list[float]] = {}
    seen = said

    def all_answered() -> bool:
        nonlocal seen
        while seen < len(agentd.said):
            if (match := _TOOK.search(agentd.said[seen][1])) is not None:
                took[match[1]] = [float(one) for one in match[2].split(",")]
            seen += 1
        return len(took) == agents

    with suppress(BenchmarkFailed):  # what came until then is told
        await until(all_answered, f"all {agents} agents have their answers", ANSWERING)
    if agentd.process.poll() is not None or commd.process.poll() is not None:
        raise BenchmarkFailed("agentd or commd ended while agents asked")
    seconds = time.monotonic() - begun
    values = [one for those in took.values() for one in those]
    means = [statistics.fmean(one) for one in took.values()] or [0.0]
    return Loaded(
        agents * each,
        len(values),
        2 * len(values) / seconds,
        spread(values) if values else NOTHING,
        statistics.median(means),
        max(means),
        100 * (agentd.cpu() - used[0]) / seconds,
        100 * (commd.cpu() - used[1]) / seconds,
    )
