"""Actions while the router is killed every few seconds: does each asker hear the end that happened, and soon?

    python -m tests.soak.actions [--actions 200] [--seed 1] [--no-report]

Four robots on one bridge: two carry out what agents ask for, two what Python clients ask for (`commd.client`), each one
action after the other, of seeded durations and outcomes. The router's process (commd) is killed (-9) and started again
all the time. What agents and clients heard is compared with the bridge's ledger and with the robots' own journal.
Writes its section of docs/measurements/soak.md.
"""

import argparse
import asyncio
import random
import signal
import statistics
import sys
import tempfile
import time
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from bridged.bridge.action_log import decoded
from commd.client import Client, join
from schemas.mission.model import load_mission
from schemas.wire.records import FINAL_STATES, State
from tests.soak.report import table, write_section
from tests.support.ports import neighbouring_ports
from tests.support.processes import Daemon

ACTIONS = 200
UP = (2.0, 4.0)
"""Wall seconds from the router's return to its next kill."""
DURATION = (0.2, 6.0)
"""Wall seconds that a robot takes for one action."""
GOES_WRONG = 0.25
"""Share of the actions that fail at the robot."""
HEARD_WITHIN = 5.0
"""Wall seconds, from the end of an action, or from the return of a router that was away then, until its asker hears."""
AGENTS, CLIENTS = ("a1", "a2"), ("c1", "c2")
START = 60.0
"""Wall seconds that a daemon has to start."""
PER_ACTION = 15.0
"""Wall seconds that one action may take on average before the run is given up."""
MANIFEST = """\
[robot]
driver = "python"

[orders]
hold = "stand(1)"

[actions.stand]
params = [{name = "here", type = "int"}]
call = "worker.stand"

[actions.work]
params = [
  {name = "robot", type = "string"},
  {name = "number", type = "int"},
  {name = "seconds"},
  {name = "good", type = "boolean"},
]
call = "worker.work"
deadline = "60s"
"""
WORKER = """\
import pathlib, time
__all__ = ["stand", "work"]
JOURNAL = pathlib.Path(__file__).with_name("journal.txt")
def note(*words):
    with JOURNAL.open("a") as file:
        file.write(" ".join(map(str, words)) + "\\n")
def stand(here):
    pass
def work(robot, number, seconds, good):
    note("began", robot, number, time.time())
    until = time.time() + seconds
    while (left := until - time.time()) > 0:
        yield {"to_go": left}
        time.sleep(min(0.1, left))
    note("good" if good else "wrong", robot, number, time.time())
    return True if good else f"work {number} went wrong"
"""
PROGRAM = """\
!go(1).
+!go(N) : task(N, Seconds, Good) <- !work(N, Seconds, Good); !!go(N+1).
+!go(_) <- .print("all heard").
+!work(N, Seconds, Good) <- work(ME, N, Seconds, Good); .print("heard ", N, " succeeded").
-!work(N, _, _)[state(State)] <- .print("heard ", N, " ", State).
"""


@dataclass(frozen=True)
class Task:
    """One action: what the robot is to do."""

    seconds: float
    good: bool


@dataclass
class Heard:
    """What an asker heard of an action, and when (Unix seconds)."""

    state: str
    at: float


@dataclass
class Result:
    """What all sides say of the actions, by asker and number."""

    seconds: float = 0.0
    heard: dict[tuple[str, int], Heard] = field(default_factory=dict)
    ledger: dict[tuple[str, int], State] = field(default_factory=dict)
    begun: Counter[tuple[str, int]] = field(default_factory=Counter)
    journal: dict[tuple[str, int], tuple[State, float]] = field(default_factory=dict)
    """How each ended at the robot, and when."""
    outages: list[tuple[float, float]] = field(default_factory=list)
    """When the router was killed, and when it was back."""
    asked: dict[tuple[str, int], Task] = field(default_factory=dict)

    def disagreements(self) -> list[str]:
        """Return each action of which asker, ledger and robot say different things, or that was not done once."""
        found = []
        for key in self.asked:
            heard = self.heard[key].state if key in self.heard else "nothing"
            robot = self.journal[key][0] if key in self.journal else "no end"
            if not heard == self.ledger.get(key) == robot or self.begun[key] != 1:
                reported = f"heard {heard}, ledger {self.ledger.get(key)}, robot {robot}, begun {self.begun[key]} times"
                found.append(f"{key[0]} {key[1]}: {reported}")
        return found

    def delay(self, key: tuple[str, int]) -> float:
        """Return the wall seconds in which the asker heard, from the first moment at which it could."""
        ended = self.journal[key][1]
        place = bisect_right(self.outages, (ended, float("inf"))) - 1
        could = max(ended, self.outages[place][1]) if place >= 0 else ended
        return self.heard[key].at - could

    def delays(self) -> dict[tuple[str, int], float]:
        """Return `delay` of each action that was heard of and ended."""
        return {key: self.delay(key) for key in self.asked if key in self.heard and key in self.journal}

    def across(self) -> int:
        """Return how many actions met at least one outage while they were under way."""
        return sum(
            any(
                self.journal[key][1] - task.seconds < back and killed < self.heard[key].at
                for killed, back in self.outages
            )
            for key, task in self.asked.items()
            if key in self.journal and key in self.heard
        )


class Stamped(Daemon):
    """A daemon whose lines are noted with the time at which they came."""

    def _read(self) -> None:
        self.stamped: list[tuple[float, str]] = []
        for line in self.process.stdout:
            self.stamped.append((time.time(), line.rstrip("\n")))
            self.lines.append(line.rstrip("\n"))


def tasks_of(actions: int, seed: int) -> dict[str, list[Task]]:
    """Return what each asker asks for, in order."""
    draw = random.Random(seed)
    askers = (*AGENTS, *CLIENTS)
    found: dict[str, list[Task]] = {backfill: [] for backfill in askers}
    for number in range(actions):
        found[askers[number % len(askers)]].append(Task(round(draw.uniform(*DURATION), 2), draw.random() > GOES_WRONG))
    return found


def write_files(folder: Path, tasks: dict[str, list[Task]]) -> Path:
    """Write mission, manifest, programs and the package of the robots' functions. Returns the mission's path."""
    robots = {backfill: f"r_{backfill}" for backfill in tasks}
    lines = ["mission: soak", "agents:"]
    lines += [f"  {one}: {{program: {one}.asl, robot: {robots[one]}}}" for one in AGENTS]
    lines += ["clients:", *(f"  {one}: {{robot: {robots[one]}}}" for one in CLIENTS), "robots:"]
    lines += [
        f"  {robot}: {{manifest: worker.toml, on_agent_loss: [hold], on_shutdown: hold}}" for robot in robots.values()
    ]
    (folder / "soak.yaml").write_text("\n".join([*lines, 'done: "a1: never"', ""]))
    (folder / "worker.toml").write_text(MANIFEST)
    for agent in AGENTS:
        reported = (
            f"task({n}, {one.seconds}, {str(one.good).lower()})." for n, one in enumerate(tasks[agent], start=1)
        )
        (folder / f"{agent}.asl").write_text("\n".join([*reported, PROGRAM.replace("ME", f'"{agent}"')]))
    (folder / "worker.py").write_text(WORKER)
    info = folder / "worker-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: worker\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[argosy.python]\nworker = worker\n")
    return folder / "soak.yaml"


class Router:
    """The board's commd, whose process is killed and started again."""

    def __init__(self, mission: Path, endpoint: str, folder: Path) -> None:
        self._arguments = ("commd", "serve", str(mission), "--router", endpoint, "--state", str(folder))
        self.outages: list[tuple[float, float]] = []
        self._start()

    def _start(self) -> None:
        self.daemon = Daemon(*self._arguments)
        self.daemon.says("router board=", START)

    def fail(self) -> None:
        """Kill it and start it again."""
        killed = time.time()
        self.daemon.kill()
        self._start()
        self.outages.append((killed, time.time()))


@contextmanager
def started(*arguments: str, folder: Path) -> Iterator[Stamped]:
    """Run a daemon that finds the package of the robots' functions in a folder, and end it when the block ends."""
    daemon = Stamped(*arguments, environment={"PYTHONPATH": str(folder)})
    try:
        yield daemon
    finally:
        daemon.kill()


async def ask_all(me: Client, tasks: list[Task], result: Result) -> None:
    """Let a client ask for its actions, one after the other."""
    for number, task in enumerate(tasks, start=1):
        status = await me.perform("work", me.name, number, task.seconds, task.good)
        result.heard[me.name, number] = Heard(status.state, time.time())


async def clients_and_kills(
    mission: Path,
    endpoint: str,
    tasks: dict[str, list[Task]],
    agents: Stamped,
    router: Router,
    seed: int,
    result: Result,
) -> None:
    """Let the clients act, and kill the router again and again, until all have heard of all."""
    draw = random.Random(seed + 1)

    async def client(name: str) -> None:
        async with join(name, mission=load_mission(mission), router=endpoint, patience=START) as me:
            await ask_all(me, tasks[name], result)

    async def killing() -> None:
        while True:
            await asyncio.sleep(draw.uniform(*UP))
            await asyncio.to_thread(router.fail)

    async def all_heard() -> None:
        while sum(line.endswith("all heard") for line in list(agents.lines)) < len(AGENTS):
            await asyncio.sleep(0.1)

    kills = asyncio.create_task(killing())
    try:
        async with asyncio.timeout(START + PER_ACTION * max(map(len, tasks.values()))):
            await asyncio.gather(all_heard(), *(client(name) for name in CLIENTS))
    except TimeoutError:
        print("not all was heard in time", file=sys.stderr)
    finally:
        kills.cancel()
        await asyncio.gather(kills, return_exceptions=True)


def soak(actions: int, seed: int, folder: Path) -> Result:
    """Run so many actions and return what all sides say of them."""
    result, tasks = Result(), tasks_of(actions, seed)
    result.asked = {(backfill, n): task for backfill, its in tasks.items() for n, task in enumerate(its, start=1)}
    mission = write_files(folder, tasks)
    endpoint = f"tcp/127.0.0.1:{neighbouring_ports(1)[0]}"
    where = ("--router", endpoint, "--state", str(folder / "state"))
    began = time.monotonic()
    with ExitStack() as stack:
        router = Router(mission, endpoint, folder / "state")
        stack.callback(lambda: router.daemon.kill())
        bridge = stack.enter_context(started("bridged", "serve", str(mission), *where, folder=folder))
        bridge.says("serving r_c2", START)
        agents = stack.enter_context(started("agentd", "serve", str(mission), *where, folder=folder))
        asyncio.run(clients_and_kills(mission, endpoint, tasks, agents, router, seed, result))
        for daemon in (agents, bridge):
            daemon.signal(signal.SIGTERM)
            daemon.ends()
        result.outages = router.outages
        (folder / "agentd.log").write_text(agents.text)
        (folder / "bridged.log").write_text(bridge.text)
    result.seconds = time.monotonic() - began
    for at, line in agents.stamped:
        match line.split():
            case [name, "heard", number, state] if name.strip("[]") in AGENTS:
                result.heard[name.strip("[]"), int(number)] = Heard(state, at)
    read_journal(folder / "journal.txt", result)
    read_ledgers(folder / "state", result)
    return result


def read_journal(path: Path, result: Result) -> None:
    """Take in what the robots have done."""
    for line in path.read_text().splitlines():
        word, robot, number, at = line.split()
        key = robot, int(number)
        if word == "began":
            result.begun[key] += 1
        else:
            result.journal[key] = ("succeeded" if word == "good" else "failed"), float(at)


def read_ledgers(folder: Path, result: Result) -> None:
    """Take in how the bridge says that each action ended; ids count up in the order in which an asker has asked."""
    ended: dict[str, dict[int, State]] = {}
    for path in folder.rglob("*.actions"):
        for line in path.read_bytes().splitlines():
            entry = decoded(line)
            if entry.id and entry.state in FINAL_STATES:
                ended.setdefault(entry.agent, {})[int(entry.id.rpartition(":")[2])] = entry.state
    for backfill, states in ended.items():
        for number, key in enumerate(sorted(states), start=1):
            result.ledger[backfill, number] = states[key]


def report(result: Result, seed: int) -> list[str]:
    """Return the section of the report."""
    delays = sorted(result.delays().values())
    late = sum(delay > HEARD_WITHIN for delay in delays)
    away = [back - killed for killed, back in result.outages]
    states = Counter(heard.state for heard in result.heard.values())
    rows = []
    for what, askers in (("agents (agentd)", AGENTS), ("Python clients", CLIENTS)):
        asked = [key for key in result.asked if key[0] in askers]
        found = sorted(delay for key, delay in result.delays().items() if key[0] in askers)
        wrong = sum(line.split()[0] in askers for line in result.disagreements())
        times = (f"{statistics.median(found):.2f}", f"{found[-1]:.2f}") if found else ("", "")
        rows.append((what, len(asked), wrong, *times))
    return [
        f"**{len(result.asked)} actions**, half of agents and half of Python clients, seed {seed}, while the router's "
        f"process was killed (-9) {len(result.outages)} times, {UP[0]:g} to {UP[1]:g} s after each return, and gone "
        f"for {min(away):.1f} to {max(away):.1f} s: **{len(result.disagreements())} disagreements** between what the "
        f"asker heard, the bridge's ledger and the robot's journal, in which each was begun once; **{late} heard later "
        f"than {HEARD_WITHIN:g} s** after the end or, if it ended while the router was away, after its return.",
        "",
        *table("asker | actions | disagreements | heard after, median s | most s", rows),
        "",
        f"{result.across()} of the actions met an outage while they were under way. Heard: "
        f"{', '.join(f'{count} {state}' for state, count in states.most_common())}. It took {result.seconds:.0f} s.",
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--actions", type=int, default=ACTIONS)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for logs and ledgers (default: a temporary one)")
    parser.add_argument("--no-report", action="store_true")
    args = parser.parse_args()
    with ExitStack() as stack:
        folder = args.keep or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        folder.mkdir(parents=True, exist_ok=True)
        result = soak(args.actions, args.seed, folder)
    lines = report(result, args.seed)
    print("\n".join([*lines, *result.disagreements()]))
    if not args.no_report:
        write_section("Actions under a router that is killed", lines)
    late = any(delay > HEARD_WITHIN for delay in result.delays().values())
    return 1 if result.disagreements() or late else 0


if __name__ == "__main__":
    sys.exit(main())
