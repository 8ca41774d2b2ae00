"""The table of processes that a mission needs on this machine: which kinds there are, for whom, and by which command.

The order of the table is the order of the start; its reverse is the order of the end.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from argosy import simulators
from argosy.links import together
from schemas.mission import THIS_MACHINE, Mission

ALL = "all"
"""`--real all`: no robot is simulated."""


@dataclass(frozen=True)
class Setup:
    """A mission and how it is to be run now."""

    mission: Mission
    router: str
    """Zenoh endpoint of the board's router."""
    speed: float
    real: frozenset[str]
    """Robots that are not simulated."""
    state: Path
    """Where daemons keep what must survive their restart within this run."""
    telling: frozenset[str] = frozenset()
    """Robots whose manifest has the percept `state(Mode, Connected, Armed)`: the run waits for their vehicle."""

    @property
    def file(self) -> str:
        """The mission file, whatever the working directory of a daemon is."""
        return str(self.mission.path.resolve())

    def simulators(self) -> list[str]:
        """Return the robots whose simulator is started; the driver of another simulated one is its own twin."""
        robots = self.mission.robots.items()
        return [name for name, robot in robots if name not in self.real and simulators.vehicle_of(robot)]

    def mixed(self) -> list[str]:
        """Return the robots of a link of which some are real and some simulated, if there is such a link."""
        groups = together(self.mission)
        return next((group for group in groups if 0 < len(self.real.intersection(group)) < len(group)), [])

    def agents_by_board(self) -> dict[str, list[str]]:
        """Return the agents of each board: those of one board share a daemon."""
        boards: dict[str, list[str]] = {}
        for name, agent in self.mission.agents.items():
            boards.setdefault(agent.board, []).append(name)
        return boards


@dataclass(frozen=True)
class Kind:
    """A kind of process."""

    name: str
    subjects: Callable[[Setup], list[str]]
    """For whom one is started: a board, a simulated robot, the robots of a bridge or the agents of a board (separated
    by spaces)."""
    command: Callable[[Setup, str], list[str]]
    """The module to run and its arguments."""
    orphaned: Callable[[Setup, str], signal.Signals] = lambda setup, subject: signal.SIGKILL
    """What the kernel sends it when `argosy run` itself is killed."""
    measured: bool = True
    """Whether it counts as one of the daemons that a board runs in flight."""


def _simulator(setup: Setup, robot: str) -> list[str]:
    declared = setup.mission.robots[robot]
    signing = declared.signing if simulators.vehicle_of(declared) == "copter" else None
    signed = ["--signing-passphrase-file", str(setup.mission.relative(signing.passphrase_file))] if signing else []
    return [*simulators.command(declared, setup.router), *signed, *_speed(setup)]


def _bridge(setup: Setup, robots: str) -> list[str]:
    served = robots.split()
    twins = [] if setup.real.intersection(served) else ["--simulated"]
    where = ["--router", setup.router, *_speed(setup), "--state", str(setup.state)]
    return ["bridged", "serve", setup.file, *served, *where, *twins]


def _orphaned_bridge(setup: Setup, robots: str) -> signal.Signals:
    return signal.SIGTERM if setup.real.intersection(robots.split()) else signal.SIGKILL  # a real one is brought home


def _speed(setup: Setup) -> list[str]:
    return ["--speed", f"{setup.speed:g}"]


def _board(setup: Setup) -> list[str]:
    return [next(iter(setup.mission.boards), THIS_MACHINE)]


KINDS: tuple[Kind, ...] = (
    Kind("commd", _board, lambda s, board: ["commd", "serve", s.file, "--board", board, "--router", s.router]),
    Kind("simulator", lambda s: s.simulators(), _simulator, measured=False),
    Kind("bridged", lambda s: [" ".join(robots) for robots in together(s.mission)], _bridge, _orphaned_bridge),
    Kind(
        "agentd",
        lambda s: [" ".join(agents) for agents in s.agents_by_board().values()],
        lambda s, agents: ["agentd", "serve", s.file, *agents.split(), "--router", s.router, *_speed(s)],
    ),
)


@dataclass(frozen=True)
class Process:
    """One process to be started."""

    kind: Kind
    subject: str
    argv: tuple[str, ...]
    orphaned: signal.Signals = signal.SIGKILL

    @property
    def name(self) -> str:
        """What people call it: `commd`, `bridged uav1`."""
        return f"{self.kind.name} {self.subject}" if self.kind.name != "commd" else "commd"


def plan(setup: Setup) -> list[Process]:
    """Return every process of the mission on this machine, in the order of the start."""
    python = (sys.executable, "-P", "-m")  # -P: a user's folder `schemas/` must not come before ours
    return [
        Process(kind, subject, (*python, *kind.command(setup, subject)), kind.orphaned(setup, subject))
        for kind in KINDS
        for subject in kind.subjects(setup)
    ]


def real_robots(mission: Mission, named: list[str]) -> tuple[frozenset[str], list[str]]:
    """Return the robots that are real when `--real` names these, and the names that it does not know.

    A robot may also be named by its agent; a robot without `simulate` is real in any case.
    """
    real = {name for name, robot in mission.robots.items() if robot.simulate is None}
    unknown: list[str] = []
    for name in named:
        agent = mission.agents.get(name)
        if name == ALL:
            real |= set(mission.robots)
        elif name in mission.robots:
            real.add(name)
        elif agent is not None and agent.robot is not None:
            real.add(agent.robot)
        else:
            unknown.append(name)
    return frozenset(real), unknown
