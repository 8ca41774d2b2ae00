"""Run vehicles that only talk, with their agents, on one board, as the product starts them, and observe them."""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from argosy.processes.process_table import Setup, places, plan
from benchmarks import health
from benchmarks.health import DAEMONS
from benchmarks.measurements.vehicles import POSITIONS, Report
from benchmarks.processes import BenchmarkFailed, Watched, memory, pss, until, watched
from benchmarks.results import busy_seconds
from benchmarks.spread import NOTHING, Spread, spread
from schemas.mission.model import load_mission
from tests.support.ports import free_port

BEAT_LATE: Final = 1.5
"""Seconds between two heartbeats of the bridge after which the second one is late: one is due each second."""
LATE: Final = 1000.0 / POSITIONS
"""Milliseconds from a position to its belief after which the next position is there already."""
IN_TIME: Final = 0.99
"""So large a part of the positions is to be a belief before the next one is due."""
PATIENCE: Final = 90.0
"""Seconds that all agents have to serve their vehicles, from the start of the last daemon."""
SETTLE: Final = 4.0
"""Seconds from then on before anything counts."""


FLEET: Final = "scale"
MOST_POSITIONS: Final = 100
"""Positions a second, of all agents together, that plans print: their reader must not be what is measured."""
ASK_EVERY: Final = 1000
"""Milliseconds between the answer to an agent's question and its next one."""
_PROGRAM: Final = """\
!begin.
+!begin <- .wait(bridge(up), 300000); .print("serves"); !!ask_on.
+altitude(A) : every(K, First) & A mod K == First <- .print("at ", A).
+!ask_on <- .random(R); .wait(1000 * R); !!ask.
+!ask : pause(P)
  <- .nano_time(B);
     get_param("RTL_ALT");
     .nano_time(E);
     .print("asked ", (E - B) / 1000);
     .wait(P);
     !!ask.
-!ask[error_msg(Why)] : pause(P) <- .print("not report: ", Why); .wait(P); !!ask.
"""


@dataclass(frozen=True)
class Field:
    """A mission on disk, and where its vehicles meet their bridges."""

    mission: Path
    router: str
    ports: list[int]
    """Of the links on loopback: one for all, or one for each vehicle."""
    every: int
    """So many metres lie between two altitudes that a plan prints; vehicle after vehicle begins at another of them, so
    that no moment of the second is left out."""


def write_mission(folder: Path, size: int, *, own_links: bool) -> Field:
    """Write a mission of `size` vehicles, which share a link or have one each."""
    (folder / "watcher.asl").write_text(_PROGRAM)
    router = f"tcp/127.0.0.1:{free_port()}"
    shared = free_port()
    ports = [free_port() if own_links else shared for _ in range(size)]
    every = max(1, size * POSITIONS // MOST_POSITIONS)
    agents = [
        f"  agent{one}: {{program: watcher.asl, robot: uav{one}, "
        f'beliefs: ["pause({ASK_EVERY})", "every({every}, {one % every})"]}}'
        for one in range(1, size + 1)
    ]
    robots = [
        f"  uav{one}: {{manifest: copter, link: 'udpin:127.0.0.1:{port}', sysid: {one}}}"
        for one, port in enumerate(ports, 1)
    ]
    lines = [f"mission: {FLEET}", "agents:", *agents, "robots:", *robots, f"router: {{endpoint: {router}}}", ""]
    mission = folder / "scale.yaml"
    mission.write_text("\n".join(lines))
    return Field(mission, router, ports, every)


@dataclass
class Use:
    """What the processes of one kind used over a time."""

    processes: int
    cpu: float = 0.0
    """Per cent of a core, all together."""
    pss: float = 0.0
    """MB (10^6), all together; what they share counts once."""
    rss: float = 0.0
    """MB, all together."""


@dataclass
class Run:
    """What was found at one size."""

    size: int
    own_links: bool
    """Each vehicle has a link, and so a bridge, of its own; otherwise all share one."""
    seconds: float
    serving: int = 0
    """Agents that served their vehicle within `PATIENCE`."""
    ready: float = 0.0
    """Seconds from the start of the first bridge until the last of these agents did."""
    busy: float = 0.0
    """Per cent of all cores of the machine."""
    use: dict[str, Use] = field(default_factory=dict)
    """By kind: commd, bridged, agentd, talkers."""
    messages: float = 0.0
    """MAVLink messages a second that bridges took in."""
    percepts: float = 0.0
    """Percepts a second that bridges report, as they count them."""
    percept: Spread = NOTHING
    """From the moment before a position is sent to the line that a plan prints for its belief."""
    unseen: int = 0
    """Positions that became no belief."""
    in_time: float = 1.0
    """So large a part of all positions that were sent were beliefs before the next one was due."""
    asked: Spread = NOTHING
    """From an action to its success: the vehicle is asked for a parameter."""
    actions: dict[str, int] = field(default_factory=dict)
    """How actions ended."""
    missed: dict[str, int] = field(default_factory=dict)
    """Deadlines that were missed, and what was lost."""
    lag: dict[str, float] = field(default_factory=dict)
    """By kind of daemon: seconds by which its loop was late at worst."""

    def cpu(self) -> float:
        """Per cent of a core, of all daemons."""
        return sum(self.use[kind].cpu for kind in DAEMONS)

    def pss(self) -> float:
        """MB, of all daemons."""
        return sum(self.use[kind].pss for kind in DAEMONS)

    def not_served(self) -> list[str]:
        """Return as text what this size did not get in time; none: it got everything."""
        lacking = self.size - self.serving
        found = [f"agents that did not serve their vehicle: {lacking}"] if lacking else []
        if self.in_time < IN_TIME:
            found.append(f"{1 - self.in_time:.1%} of the positions were no belief when the next one was due")
        return found + [f"{what}: {count}" for what, count in self.missed.items() if count]


def run(size: int, *, seconds: float, own_links: bool = False, settle: float = SETTLE) -> Run:
    """Start everything, let it run, and observe. Raises BenchmarkFailed if a process ends or no agent serves."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        made = write_mission(folder, size, own_links=own_links)
        parts, started = start(stack, folder, made)
        records = stack.enter_context(health.listening(made.router, FLEET))
        found = Run(size, own_links, seconds)
        found.serving, found.ready = wait_for_all(size, parts, started)
        time.sleep(settle)
        lost, begun, busy, used = lost_datagrams(made.ports), time.monotonic(), busy_seconds(), _cpu(parts)
        time.sleep(seconds)
        ended, after = time.monotonic(), _cpu(parts)
        found.seconds = ended - begun
        found.busy = 100 * (busy_seconds() - busy) / found.seconds / (os.cpu_count() or 1)
        for kind, those in parts.items():
            cpu = 100 * (after[kind] - used[kind]) / found.seconds
            pids = [one.process.pid for one in those]
            found.use[kind] = Use(len(those), cpu, pss(pids), sum(memory(pid, "VmRSS") for pid in pids))
        lost = lost_datagrams(made.ports) - lost
        time.sleep(1.0)  # what was sent last becomes a belief
        report = _talker_report(parts["talkers"][0])
        latencies(found, parts["agentd"], report, begun, ended)
        missed(found, records, report, begun, ended, lost)
        return found


def _cpu(parts: dict[str, list[Watched]]) -> dict[str, float]:
    return {kind: sum(one.cpu() for one in those) for kind, those in parts.items()}


def start(stack: ExitStack, folder: Path, made: Field) -> tuple[dict[str, list[Watched]], float]:
    """Start the processes of the mission as `argosy run` does, and its vehicles.

    Returns them by their kinds, and when the first bridge was started.
    """
    mission = load_mission(made.mission)
    setup = Setup(
        mission, made.router, 1.0, frozenset(mission.robots), folder / "state", places=places(mission, made.router)
    )
    parts: defaultdict[str, list[Watched]] = defaultdict(list)
    begun = 0.0
    for process in plan(setup):
        kind = process.kind.name
        if kind == "bridged" and not parts[kind]:
            begun = time.monotonic()
        parts[kind].append(stack.enter_context(watched(process.name, *process.argv[1:])))
        if kind == "commd":
            parts[kind][-1].wait_for("router board=")
    where = [f"{robot.sysid}:{port}" for robot, port in zip(mission.robots.values(), made.ports, strict=True)]
    talkers = ("-m", "benchmarks.measurements.vehicles", str(made.every), *where)
    parts["talkers"].append(stack.enter_context(watched("talkers", *talkers)))
    return dict(parts), begun


def wait_for_all(size: int, parts: dict[str, list[Watched]], begun: float) -> tuple[int, float]:
    """Wait until the agents serve their vehicles.

    Returns how many do within `PATIENCE`, and the seconds from the moment `begun` until the last of them did. Raises
    BenchmarkFailed if none does, or a process has ended.
    """
    served: dict[str, float] = {}

    def all_serve() -> bool:
        served.update(
            (line.partition("]")[0], at) for at, line in list(parts["agentd"][0].output) if line.endswith("] serves")
        )
        return len(served) == size or bool(_ended(parts))

    until(all_serve, PATIENCE, 0.1)
    if _ended(parts) or not served:
        last = "\n".join(line for those in parts.values() for one in those[:3] for _, line in one.output[-3:])
        raise BenchmarkFailed(f"{size} vehicles: ended: {_ended(parts)}, serving: {len(served)}; last:\n{last}")
    return len(served), max(served.values()) - begun


def _ended(parts: dict[str, list[Watched]]) -> list[str]:
    return [one.name for those in parts.values() for one in those if one.process.poll() is not None]


def _talker_report(talkers: Watched) -> Report:
    talkers.process.terminate()
    until(lambda: bool(talkers.when("REPORT ")), PATIENCE)
    for _, line in talkers.output:
        if line.startswith("REPORT "):
            return msgspec.json.decode(line.removeprefix("REPORT "), type=Report)
    raise BenchmarkFailed("the vehicles did not report what they had sent")


def lost_datagrams(ports: Iterable[int]) -> int:
    """Return how many datagrams the kernel has dropped so far at UDP ports, for their buffers were full."""
    wanted = {f"{port:04X}" for port in ports}
    lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    return sum(int(fields[-1]) for line in lines if (fields := line.split())[1].rpartition(":")[2] in wanted)


_AT: Final = re.compile(r"\[agent(\d+)\] at (\d+)$")
_ASKED: Final = re.compile(r"\[agent\d+\] asked ([\d.eE+-]+)$")
_STATE: Final = re.compile(r" action=(\w+) .*\bstate=(\w+)")


def latencies(found: Run, agents: list[Watched], report: Report, begun: float, ended: float) -> None:
    """Read how long positions and actions took from what agents have printed, and when positions were sent."""
    came: dict[tuple[int, int], float] = {}
    asked: list[float] = []
    actions: Counter[str] = Counter()
    for at, line in (one for daemon in agents for one in daemon.output):
        if position := _AT.search(line):
            came[int(position[1]), int(position[2])] = at
        elif begun <= at <= ended and (answer := _ASKED.search(line)):
            asked.append(float(answer[1]) / 1000)
        elif begun <= at <= ended and (status := _STATE.search(line)):
            actions[status[2]] += 1
    sent = {
        (system, metres): at
        for system, those in report.sent.items()
        for metres, at in those.items()
        if begun <= at <= ended
    }
    took = [1000 * (came[one] - sent[one]) for one in sent.keys() & came.keys()]
    found.percept = spread(took) if took else NOTHING
    found.unseen = len(sent) - len(took)
    found.in_time = sum(one <= LATE for one in took) / len(sent) if sent else 0.0
    found.asked = spread(asked) if asked else NOTHING
    found.actions = dict(actions)


def missed(found: Run, records: health.Records, report: Report, begun: float, ended: float, datagrams: int) -> None:
    """Count what was late or lost between two moments, and what bridges took in and published."""
    grown = health.grown(records, begun, ended)
    bridges, agents, boards = (grown[kind] for kind in ("bridged", "agentd", "commd"))
    found.lag = records.lag(begun, ended)
    found.messages, found.percepts = bridges.rates["messages"], bridges.rates["percepts"]
    found.missed = {
        "actions timed out": found.actions.get("timed_out", 0),
        "actions failed or refused": sum(found.actions.get(one, 0) for one in ("failed", "refused")),
        "percepts that grew stale": bridges.counts["percepts_expired"],
        "percepts that did not come": agents.counts["percepts_missed"],
        "percepts that came after the status that refers to them": agents.counts["percepts_late"],
        "heartbeats of a bridge late": sum(
            health.gaps(times, begun, ended, BEAT_LATE) for times in report.beats.values()
        ),
        "health records late": health.late(records, begun, ended),
        "datagrams lost before the bridge": datagrams,
        "dropped by queues": sum(one.counts["drops"] for one in (bridges, agents, boards)),
        "not readable": sum(one.counts["bad_input"] for one in (bridges, agents, boards)),
        "lines logged as errors": health.errors(records, begun, ended),
    }
