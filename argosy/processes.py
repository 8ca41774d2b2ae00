"""The table of processes that a mission needs on this machine: which kinds there are, for whom, and by which command.

The order of the table is the order of the start; its reverse is the order of the end.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bridged.drivers.mavlink.address import LinkAddress, LinkAddressError
from schemas.findings import Finding
from schemas.mission import THIS_MACHINE, Mission

ALL = "all"
"""`--real all`: no robot is simulated."""
_PEERS = {"udpin": "udpout", "udpout": "udpin", "tcpin": "tcp", "tcp": "tcpin"}
_ANYWHERE = "0.0.0.0"  # noqa: S104  to compare with, not to bind
_LOOPBACK = {"localhost": "127.0.0.1", "::1": "127.0.0.1", "::": _ANYWHERE}
_ANY_ADDRESS = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104  we call there, we do not bind


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

    def simulated(self) -> list[str]:
        """Return the robots whose simulator is started."""
        return [name for name in self.mission.robots if name not in self.real]

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
    """For whom one is started: a board, a robot, or the agents of a board (separated by spaces)."""
    command: Callable[[Setup, str], list[str]]
    """The module to run and its arguments."""
    orphaned: Callable[[Setup, str], signal.Signals] = lambda setup, subject: signal.SIGKILL
    """What the kernel sends it when `argosy run` itself is killed."""
    measured: bool = True
    """Whether it counts as one of the daemons that a board runs in flight."""


def _simulator(setup: Setup, robot: str) -> list[str]:
    declared = setup.mission.robots[robot]
    assert declared.simulate is not None
    assert declared.simulate.home is not None
    home = ",".join(map(repr, declared.simulate.home))
    link = str(peer_of(LinkAddress.parse(declared.link)))
    where = ["--link", link, f"--home={home}", "--sysid", str(declared.sysid)]  # `=`: a latitude may be negative
    return ["bridged", "simulate", declared.simulate.vehicle, *where, *_speed(setup)]


def _speed(setup: Setup) -> list[str]:
    return ["--speed", f"{setup.speed:g}"]


def _board(setup: Setup) -> list[str]:
    return [next(iter(setup.mission.boards), THIS_MACHINE)]


KINDS: tuple[Kind, ...] = (
    Kind("commd", _board, lambda s, board: ["commd", "serve", s.file, "--board", board, "--router", s.router]),
    Kind("simulator", lambda s: s.simulated(), _simulator, measured=False),
    Kind(
        "bridged",
        lambda s: list(s.mission.robots),
        lambda s, robot: [
            *("bridged", "serve", s.file, robot, "--router", s.router, *_speed(s)),
            *("--state", str(s.state)),
        ],
        orphaned=lambda s, robot: signal.SIGTERM if robot in s.real else signal.SIGKILL,  # a real one is brought home
    ),
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


def peer_of(link: LinkAddress) -> LinkAddress:
    """Return the other end of a link, on this machine. Raises LinkAddressError for a serial line."""
    if link.kind == "serial":
        raise LinkAddressError(str(link), "a simulated robot needs a udpin, udpout, tcp or tcpin link")
    kind = _PEERS[link.kind]
    host = _ANY_ADDRESS.get(link.host, link.host) if link.kind.endswith("in") else link.host
    return LinkAddress.parse(f"{kind}:[{host}]:{link.port}" if ":" in host else f"{kind}:{host}:{link.port}")


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


def check_links(mission: Mission) -> list[Finding]:
    """Return what is wrong with the link strings, whoever is at their other end."""
    findings: list[Finding] = []
    taken: dict[str, LinkAddress] = {}
    for name, robot in mission.robots.items():
        where = ("robots", name, "link")
        try:
            link = LinkAddress.parse(robot.link)
        except LinkAddressError as error:
            findings.append(mission.positions.finding(where, str(error)))
            continue
        for other, its in taken.items():
            if _collide(link, its) and mission.robots[other].link != robot.link:  # else `load_mission` has told
                text = f"`{link}` is the port of robot `{other}` already: one robot per link"
                findings.append(mission.positions.finding(where, text))
        taken[name] = link
    return findings


def only_real(mission: Mission) -> list[str]:
    """Return the robots that declare a simulation but whose link nobody can simulate."""
    robots = mission.robots.items()
    return [name for name, robot in robots if robot.simulate is not None and robot.link.startswith("serial:")]


def bound_links(setup: Setup) -> dict[str, LinkAddress]:
    """Return, by robot, the end of its link that a process of this run binds on this machine."""
    bound: dict[str, LinkAddress] = {}
    for name, robot in setup.mission.robots.items():
        link = LinkAddress.parse(robot.link)
        ends = [link] if name in setup.real else [link, peer_of(link)]
        for end in ends:
            if end.kind in ("udpin", "tcpin"):
                bound[name] = end
    return bound


def _collide(link: LinkAddress, other: LinkAddress) -> bool:
    """Whether two links, written differently, are one."""
    hosts = {_LOOPBACK.get(one.host, one.host) for one in (link, other)}
    same = len(hosts) == 1 or (_ANYWHERE in hosts and link.kind.endswith("in"))
    return (link.kind, link.port) == (other.kind, other.port) and same
