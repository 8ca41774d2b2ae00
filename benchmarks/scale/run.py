"""One run: so many UAVs with their agents, started as the product starts them, and looked at."""

from __future__ import annotations

import os
import re
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from argosy.processes.process_table import Setup, places, plan
from benchmarks.traffic import POSITIONS
from benchmarks.processes import BenchmarkFailed, memory, pss
from benchmarks.scale import health as scale_health
from benchmarks.scale.mission import FLEET, Field, Told, Vehicles, write_mission
from benchmarks.spread import NOTHING, Spread, spread
from benchmarks.watched import Watched, watched
from schemas.mission.model import load_mission

BEAT_LATE: Final = 1.5
"""Seconds between two heartbeats of the bridge after which the second one is late: one is due each second."""
LATE: Final = 1000.0 / POSITIONS
"""Milliseconds from a position to its belief after which the next position is there already."""
IN_TIME: Final = 0.99
"""So large a part of the positions is to be a belief before the next one is due."""


@dataclass
class Run:
    """What was found at one size."""

    vehicles: Vehicles
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
    """By kind: commd, bridged, agentd, simulator, talkers."""
    messages: float = 0.0
    """MAVLink messages a second that bridges took in."""
    percepts: float = 0.0
    """Percepts a second that bridges told, as they count them."""
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
    """Milliseconds by which daemons of a kind were behind at worst."""
    late_rounds: int = 0
    """Rounds of simulators more than 0.1 s late."""
    never_happened: float = 0.0
    """Seconds that simulators stood still and did not make up for, all together."""
    talkers_late: float = 0.0
    """Milliseconds by which talkers were late at worst."""

    @property
    def daemons(self) -> list[str]:
        """The kinds that are the product's."""
        return [kind for kind in ("commd", "bridged", "agentd") if kind in self.use]

    def cpu(self) -> float:
        """Per cent of a core, of all daemons."""
        return sum(self.use[kind].cpu for kind in self.daemons)

    def pss(self) -> float:
        """MB, of all daemons."""
        return sum(self.use[kind].pss for kind in self.daemons)

    def not_served(self) -> list[str]:
        """What this size did not get in time, in words; none: it got everything."""
        wanted = self.size + (self.vehicles == "copters")
        found = [f"agents that did not serve their vehicle: {wanted - self.serving}"] if self.serving < wanted else []
        if self.in_time < IN_TIME:
            found.append(f"{1 - self.in_time:.1%} of the positions were no belief when the next one was due")
        return found + [f"{what}: {count}" for what, count in self.missed.items() if count]


@dataclass
class Use:
    """What the processes of one kind used over a time."""

    processes: int
    cpu: float = 0.0
    """Per cent of a core, all together."""
    waited: float = 0.0
    """Per cent of the time that their threads were ready and no core was free, all together."""
    rss: float = 0.0
    """MB resident, all together; what they share counts for each."""
    pss: float = 0.0
    """MB (10^6), all together; what they share counts once."""


@dataclass
class Sample:
    """What processes had used at a moment, by kind, in seconds."""

    cpu: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    waited: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    idle: float = 0.0
    """Of all cores of the machine."""


def sample(pids: dict[str, list[int]]) -> Sample:
    """Look at processes now; one that has ended counts no more."""
    found = Sample(idle=_idle())
    for kind, those in pids.items():
        for pid in those:
            with suppress(OSError):
                cpu, waited = _of(pid)
                found.cpu[kind] += cpu
                found.waited[kind] += waited
    return found


def _of(pid: int) -> tuple[float, float]:
    """Seconds on a core and seconds that a core was waited for, of all threads, as the scheduler counts them.

    Nanoseconds, where `/proc/PID/stat` looks a hundred times a second who is there.
    """
    ran = waited = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):
            on_core, in_line, *_ = (task / "schedstat").read_text().split()
            ran, waited = ran + int(on_core), waited + int(in_line)
    return ran / 1e9, waited / 1e9


def _idle() -> float:
    """Seconds for which the cores had nothing to do, since the machine started.

    A core that waits for a disk is free for who is ready; one that the host of a virtual machine has taken away is not.
    """
    fields = Path("/proc/stat").read_text().split(maxsplit=6)
    return (int(fields[4]) + int(fields[5])) / os.sysconf("SC_CLK_TCK")


def used(pids: dict[str, list[int]], before: Sample, after: Sample, seconds: float) -> dict[str, Use]:
    """Return what processes used between two samples, and what they hold now."""
    found: dict[str, Use] = {}
    for kind, those in pids.items():
        found[kind] = Use(
            len(those),
            100 * (after.cpu[kind] - before.cpu[kind]) / seconds,
            100 * (after.waited[kind] - before.waited[kind]) / seconds,
            sum(memory(pid, "VmRSS") for pid in those),
            pss(those),
        )
    return found


def lost_datagrams(ports: Iterable[int]) -> int:
    """Return how many datagrams the kernel has dropped so far at UDP ports, for their buffers were full."""
    wanted = {f"{port:04X}" for port in ports}
    lines = Path("/proc/net/udp").read_text().splitlines()[1:]
    return sum(int(fields[-1]) for line in lines if (fields := line.split())[1].rpartition(":")[2] in wanted)


_AT: Final = re.compile(r"\[agent(\d+)\] at (\d+)$")
_ASKED: Final = re.compile(r"\[agent\d+\] asked ([\d.eE+-]+)$")
_STATE: Final = re.compile(r" action=(\w+) .*\bstate=(\w+)")


def latencies(found: Run, agents: list[Watched], told: Told, begun: float, ended: float) -> None:
    """Read how long positions and actions took from what agents have printed, and when positions were sent."""
    came: dict[tuple[int, int], float] = {}
    asked: list[float] = []
    actions: Counter[str] = Counter()
    for at, line in (one for daemon in agents for one in daemon.said):
        if position := _AT.search(line):
            came[int(position[1]), int(position[2])] = at
        elif begun <= at <= ended and (answer := _ASKED.search(line)):
            asked.append(float(answer[1]) / 1000)
        elif begun <= at <= ended and (status := _STATE.search(line)):
            actions[status[2]] += 1
    sent = {
        (system, metres): at
        for system, those in told.sent.items()
        for metres, at in those.items()
        if begun <= at <= ended
    }
    took = [1000 * (came[one] - sent[one]) for one in sent.keys() & came.keys()]
    found.percept = spread(took) if took else NOTHING
    found.unseen = len(sent) - len(took)
    found.in_time = sum(one <= LATE for one in took) / len(sent) if sent else 0.0
    found.asked = spread(asked) if asked else NOTHING
    found.actions = dict(actions)
    found.talkers_late = 1000 * max(
        (late for at, late in zip(told.late[::2], told.late[1::2], strict=True) if begun <= at <= ended), default=0.0
    )


def missed(found: Run, records: scale_health.Records, told: Told, begun: float, ended: float, datagrams: int) -> None:
    """Count what was late or lost between two moments, and what bridges took in and told."""
    grown = scale_health.grown(records, begun, ended)
    bridges, agents, boards = (grown[kind] for kind in ("bridged", "agentd", "commd"))
    wanted = {"commd": 1, "bridged": len(told.beats), "agentd": len(told.beats)}
    if found.vehicles == "copters":
        wanted |= dict.fromkeys(("bridged", "agentd"), found.size + 1)
    found.messages, found.percepts = bridges.rates["messages"], bridges.rates["percepts"]
    found.lag = {kind: 1000 * scale_health.worst_lag(records, kind, begun, ended) for kind in wanted}
    found.missed = {
        "actions timed out": found.actions.get("timed_out", 0),
        "actions failed or refused": sum(found.actions.get(one, 0) for one in ("failed", "refused")),
        "percepts that grew stale": bridges.counts["percepts_expired"],
        "percepts that did not come": agents.counts["percepts_missed"],
        "percepts that came after the status that refers to them": agents.counts["percepts_late"],
        "heartbeats of a bridge late": sum(
            scale_health.gaps(times, begun, ended, BEAT_LATE) for times in told.beats.values()
        ),
        "health records late": scale_health.late(records, begun, ended, wanted),
        "datagrams lost before the bridge": datagrams,
        "dropped by queues": sum(one.counts["drops"] for one in (bridges, agents, boards)),
        "not readable": sum(one.counts["bad_input"] for one in (bridges, agents, boards)),
        "lines logged as errors": scale_health.errors(records, begun, ended),
    }


_ROUNDS: Final = re.compile(r"late: (\d+) of \d+ rounds .*; ([\d.]+) s never happened")


def simulators(found: Run, copters: list[Watched], begun: float, ended: float) -> None:
    """Read what the simulators have said of their pace: what they said last less what they had said before."""
    for one in copters:
        said = [(at, int(m[1]), float(m[2])) for at, line in one.said if (m := _ROUNDS.search(line))]
        before = [told for told in said if told[0] < begun]
        late, never = (said[-1][1:] if said else (0, 0.0)), (before[-1][1:] if before else (0, 0.0))
        found.late_rounds += late[0] - never[0]
        found.never_happened += late[1] - never[1]


AT_ONCE: Final = 8
"""Simulators that start at the same time."""
PATIENCE: Final = 90.0
"""Seconds that all agents have to serve their vehicles, from the start of the last daemon."""
SETTLE: Final = 4.0
"""Seconds from then on before anything counts."""
TALKER: Final = 250
"""System id of the one vehicle that only talks among copters that fly: by it the latency is measured."""


def run(vehicles: Vehicles, size: int, *, seconds: float, own_links: bool = False, settle: float = SETTLE) -> Run:
    """Start everything, let it run, and look. Raises BenchmarkFailed if a process ends or nobody flies."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        made = write_mission(folder, vehicles, size, own_links=own_links, talker=TALKER if vehicles == "copters" else 0)
        parts, started = _started(stack, folder, made)
        records = stack.enter_context(scale_health.listening(made.router, FLEET))
        talkers = parts["talkers"][0]
        found = Run(vehicles, size, own_links, seconds)
        _wait_for_all(found, parts, size + (vehicles == "copters"), started)
        time.sleep(settle)
        pids = {kind: [one.process.pid for one in those] for kind, those in parts.items()}
        lost, begun, before = lost_datagrams(made.ports), time.monotonic(), sample(pids)
        time.sleep(seconds)
        after, ended = sample(pids), time.monotonic()
        found.seconds = ended - begun
        found.use = used(pids, before, after, found.seconds)
        found.busy = 100 * (1 - (after.idle - before.idle) / found.seconds / _cores())
        lost = lost_datagrams(made.ports) - lost
        time.sleep(1.0)  # what was sent last becomes a belief
        told = _told(talkers)
        _ended(parts)
        latencies(found, parts["agentd"], told, begun, ended)
        missed(found, records, told, begun, ended, lost)
        simulators(found, parts.get("simulator", []), begun, ended)
        return found


def _started(stack: ExitStack, folder: Path, made: Field) -> tuple[dict[str, list[Watched]], float]:
    """Start the processes of the mission as `argosy run` does, and the vehicles that only talk.

    Returns them by their kinds, and when the first bridge was started.
    """
    mission = load_mission(made.mission)
    real = frozenset(name for name, robot in mission.robots.items() if robot.simulate is None)
    setup = Setup(mission, made.router, 1.0, real, folder / "state", places=places(mission, made.router))
    parts: defaultdict[str, list[Watched]] = defaultdict(list)
    begun = 0.0
    for process in plan(setup):
        kind = process.kind.name
        if kind == "bridged" and not parts[kind]:
            begun = time.monotonic()
        started = stack.enter_context(watched(process.name, *process.argv[1:]))
        parts[kind].append(started)
        if kind == "commd":
            started.says("router board=")
        elif kind == "simulator" and len(parts[kind]) % AT_ONCE == 0:
            for one in parts[kind][-AT_ONCE:]:
                one.says("simulated copter")
    where = [f"{robot.sysid}:{port}" for robot, port in zip(mission.robots.values(), made.ports, strict=True)
             if robot.simulate is None]  # fmt: skip
    talkers = ("-m", "benchmarks.scale.mission", str(made.every), *where)
    parts["talkers"].append(stack.enter_context(watched("talkers", *talkers)))
    return dict(parts), begun


def _wait_for_all(found: Run, parts: dict[str, list[Watched]], wanted: int, begun: float) -> None:
    """Wait until the agents serve their vehicles; those that do not within `PATIENCE` are told of by their number."""
    agents, until = parts["agentd"][0], time.monotonic() + PATIENCE
    while True:
        served = {line.partition("]")[0]: at for at, line in list(agents.said) if line.endswith("] serves")}
        ended = [one.name for those in parts.values() for one in those if one.process.poll() is not None]
        if ended or (not served and time.monotonic() > until):
            last = "\n".join(line for those in parts.values() for one in those[:3] for _, line in one.said[-3:])
            raise BenchmarkFailed(
                f"{found.size} {found.vehicles}: ended: {ended}, serving: {len(served)}; last:\n{last}"
            )
        if len(served) == wanted or time.monotonic() > until:
            break
        time.sleep(0.1)
    found.serving, found.ready = len(served), max(served.values()) - begun


def _told(talkers: Watched) -> Told:
    talkers.process.terminate()
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        for _, line in reversed(talkers.said):
            if line.startswith("TOLD "):
                return msgspec.json.decode(line[5:], type=Told)
        time.sleep(0.05)
    raise BenchmarkFailed("the vehicles that only talk did not tell what they sent")


def _ended(parts: dict[str, list[Watched]]) -> None:
    """End what says something at its end: simulators."""
    for one in parts.get("simulator", []):
        one.process.terminate()
    for one in parts.get("simulator", []):
        one.process.wait(30)


def _cores() -> int:
    return os.cpu_count() or 1
