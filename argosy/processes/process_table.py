"""The table of processes that a mission needs on this machine: which kinds there are, for whom, and by which command.

The order of the table is the order of the start; its reverse is the order of the end.
"""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from argosy.cli.errors import CommandError
from argosy.cli.port_check import in_use
from argosy.processes import simulators
from argosy.processes.mavlink_links import together
from argosy.recording.run_recorder import RunRecording, record_command
from commd.process.state_dir import state_directory
from schemas.mission.model import Mission

_PORT = re.compile(r"(?P<before>.+:)(?P<port>\d+)")
_HIGHEST = 65_535


class NoPort(CommandError):
    """There are not enough free ports for the routers; the text has the first one that was tried."""


@dataclass(frozen=True)
class Place:
    """Where a board's router is on this machine."""

    router: str
    """Endpoint for the daemons of the board."""
    listen: str = ""
    """Endpoint for the routers of the other boards; empty = it has no links."""
    connect: tuple[str, ...] = ()
    """Those of the other boards that it calls; the rest call it."""

    @property
    def arguments(self) -> list[str]:
        """Arguments of `commd serve`: they override the addresses of the mission."""
        options = ["--router", self.router, *(["--listen", self.listen] if self.listen else [])]
        return [*options, *(word for endpoint in self.connect for word in ("--connect", endpoint))]


def places(mission: Mission, router: str, taken: Collection[int] = ()) -> dict[str, Place]:
    """Return where the routers of the mission's boards are: the first at `router`, the others at the next free ports.

    Ports in `taken` are left to others. Raises NoPort.
    """
    boards = mission.board_names
    if mission.router.external:
        return dict.fromkeys(boards, Place(router))
    if len(boards) == 1 and not (boards[0] in mission.boards and mission.boards[boards[0]].address):
        return {boards[0]: Place(router)}
    free = free_after(router, taken)
    routers = [router, *(next(free) for _ in boards[1:])]
    links = [next(free) for _ in boards]
    return {
        board: Place(routers[index], links[index], tuple(links[:index]))  # each link is made by the later of its boards
        for index, board in enumerate(boards)
    }


def free_after(router: str, taken: Collection[int]) -> Iterator[str]:
    """Yield the endpoints after a router's, as long as nobody listens there."""
    found = _PORT.fullmatch(router)
    if found is None:  # a socket in the file system
        number = 1
        while True:
            yield f"{router}.{number}"
            number += 1
    for port in range(int(found["port"]) + 1, _HIGHEST + 1):
        if port not in taken and not in_use(endpoint := f"{found['before']}{port}"):
            yield endpoint
    raise NoPort(f"no free port after {router} for the routers of the other boards")


ALL = "all"
"""`--real all`: no robot is simulated."""


@dataclass(frozen=True)
class Setup:
    """A mission and how it is to be run now."""

    mission: Mission
    router: str
    """Zenoh endpoint of the first board's router, where the run itself looks on."""
    speed: float
    real: frozenset[str]
    """Robots that are not simulated."""
    state: Path
    """Where daemons keep what must survive their restart within this run."""
    reporting: frozenset[str] = frozenset()
    """Robots whose manifest has the percept `state(Mode, Connected, Armed)`: the run waits for their vehicle."""
    places: Mapping[str, Place] = field(default_factory=dict)
    """Where the router of each board is; of one that is not named it is `router`."""
    restart: bool = False
    """Whether a daemon that dies is started again."""
    logs: Path | None = None
    """Folder of the report: what simulators write for a referee, and logs downloaded from vehicles."""
    recording: RunRecording | None = None
    """Where everything published is recorded."""
    links: Mapping[str, str] = field(default_factory=dict)
    """Of the robots that the mission file names no link for: the one that was found."""

    @property
    def file(self) -> str:
        """The mission file, whatever the working directory of a daemon is."""
        return str(self.mission.path.resolve())

    @property
    def vehicle_logs(self) -> Path:
        """Folder of logs downloaded from vehicles: of the report, or of this user, as `state` ends with the run."""
        return (self.logs or state_directory(None) / self.mission.fleet).resolve() / "logs"

    def place(self, board: str) -> Place:
        """Where the router of a board is on this machine."""
        return self.places.get(board) or Place(self.router)

    def simulators(self) -> list[str]:
        """Return the robots whose simulator is started; the driver of another simulated one is its own twin."""
        robots = self.mission.robots.items()
        return [name for name, robot in robots if name not in self.real and simulators.vehicle_of(robot)]

    def mixed(self) -> list[str]:
        """Return the robots of a link of which some are real and some simulated, if there is such a link."""
        groups = together(self.mission)
        return next((group for group in groups if 0 < len(self.real.intersection(group)) < len(group)), [])


@dataclass(frozen=True)
class Kind:
    """A kind of process."""

    name: str
    subjects: Callable[[Setup], list[str]]
    """For whom one is started: a board, a simulated robot, the robots of a bridge or the agents of a board (separated
    by spaces)."""
    command: Callable[[Setup, str], list[str]]
    """The module to run and its arguments."""
    board: Callable[[Setup, str], str] = lambda setup, subject: subject
    """The board that it belongs to."""
    label: Callable[[str, str], str] = lambda board, subject: board
    """Suffix of its name in a fleet of several boards, by board and subject."""
    orphaned: Callable[[Setup, str], signal.Signals] = lambda setup, subject: signal.SIGKILL
    """Signal that the kernel sends it when `argosy run` itself is killed."""
    measured: bool = True
    """Whether it counts as one of the daemons that a board runs in flight."""
    daemon: bool = True
    """Whether it may be started again when it dies: a simulator that dies is a vehicle that crashes."""
    needed: bool = True
    """Whether its death ends the run."""


def _simulator(setup: Setup, robot: str) -> list[str]:
    router = setup.place(_board_of_robots(setup, robot)).router
    return [*simulators.command(setup.mission, robot, router, logs=setup.logs), *_speed(setup)]


def _bridge(setup: Setup, robots: str) -> list[str]:
    served = robots.split()
    twins = [] if setup.real.intersection(served) else ["--simulated"]
    found = [word for name in served if name in setup.links for word in ("--link", setup.links[name])]
    where = [*_router(setup, _board_of_robots(setup, robots)), *found, *_speed(setup), *_state(setup)]
    logs = ["--logs", str(setup.vehicle_logs)]
    return ["bridged", "serve", setup.file, *served, *where, *logs, "--until-home", *twins]


def _agents(setup: Setup, agents: str) -> list[str]:
    where = _router(setup, _board_of_agents(setup, agents))
    return ["agentd", "serve", setup.file, *agents.split(), *where, *_speed(setup), *_state(setup)]


def _recorder(setup: Setup, fleet: str) -> list[str]:
    assert setup.recording is not None
    return record_command(setup.recording, setup.file, setup.router, setup.speed)


def _orphaned_bridge(setup: Setup, robots: str) -> signal.Signals:
    return signal.SIGTERM if setup.real.intersection(robots.split()) else signal.SIGKILL  # a real one is brought home


def _speed(setup: Setup) -> list[str]:
    return ["--speed", f"{setup.speed:g}"]


def _state(setup: Setup) -> list[str]:
    return ["--state", str(setup.state)]


def _router(setup: Setup, board: str) -> list[str]:
    return ["--router", setup.place(board).router]


def _board_of_robots(setup: Setup, robots: str) -> str:
    return setup.mission.robots[robots.split()[0]].board


def _board_of_agents(setup: Setup, agents: str) -> str:
    return setup.mission.agents[agents.split()[0]].board


KINDS: tuple[Kind, ...] = (
    Kind(
        "commd",
        lambda s: s.mission.board_names,
        lambda s, board: ["commd", "serve", s.file, "--board", board, *s.place(board).arguments, *_state(s)],
    ),
    Kind(
        "recorder",
        lambda s: [s.mission.fleet] if s.recording is not None else [],
        _recorder,
        lambda s, fleet: s.mission.board_names[0],
        lambda board, fleet: fleet,
        lambda s, fleet: signal.SIGTERM,  # it ends its file
        measured=False,
        daemon=False,
        needed=False,
    ),
    Kind(
        "simulator",
        lambda s: s.simulators(),
        _simulator,
        _board_of_robots,
        lambda board, robot: robot,
        measured=False,
        daemon=False,
    ),
    Kind(
        "bridged",
        lambda s: [" ".join(robots) for robots in together(s.mission)],
        _bridge,
        _board_of_robots,
        lambda board, robots: f"{board} {robots}",
        _orphaned_bridge,
    ),
    Kind(
        "agentd",
        lambda s: [" ".join(s.mission.agents_on(board)) for board in s.mission.boards_with_agents],
        _agents,
        _board_of_agents,
    ),
)


@dataclass(frozen=True)
class Process:
    """One process to be started."""

    kind: Kind
    subject: str
    argv: tuple[str, ...]
    orphaned: signal.Signals = signal.SIGKILL
    label: str = ""
    """Suffix of its name: the agents or robots that it serves, or its board."""
    board: str = ""

    @property
    def name(self) -> str:
        """Its name for people: `commd`, `bridged uav1`; with several boards `commd pi1`, `bridged pi1 uav1`."""
        return f"{self.kind.name} {self.label}".strip()


def plan(setup: Setup) -> list[Process]:
    """Return every process of the mission on this machine, in the order of the start."""
    return [_process(setup, kind, subject) for kind in KINDS for subject in kind.subjects(setup)]


def python_command() -> tuple[str, ...]:
    """Return how a daemon is begun, before its module: a user's folder `schemas/` must not come before ours."""
    return (sys.executable, "-P", "-m")


def _process(setup: Setup, kind: Kind, subject: str) -> Process:
    board = kind.board(setup, subject)
    several = len(setup.mission.board_names) > 1
    label = kind.label(board, subject) if several else subject if kind.name != "commd" else ""
    return Process(
        kind, subject, (*python_command(), *kind.command(setup, subject)), kind.orphaned(setup, subject), label, board
    )


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
