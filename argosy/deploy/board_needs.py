"""Devices and addresses that the daemons of a board use besides its socket, as far as the mission declares them.

Units allow what is needed and nothing else; the needs of a foreign driver are unknown, and reported as such.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from agentd.check.programs import read_survey
from agentd.language.compiler.compile import DirectiveError, compile_program
from agentd.language.parse import parse_file
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Program
from agentd.runtime.program_loader import compose
from agentd.runtime.program_paths import SourcePaths
from argosy.check.plan_files import named_plans
from bridged.drivers.mavlink.plan_files import BadPlan, find_plan
from bridged.drivers.mavlink.transport.address import LinkAddress, LinkAddressError
from bridged.drivers.registry import OURS, load_robot_manifest
from schemas.files.findings import Finding, Findings
from schemas.files.yaml_positions import Steps
from schemas.mission.model import Mission, Robot

_BUSES = {"/dev/ttyUSB": ("char-ttyUSB",), "/dev/ttyACM": ("char-ttyACM",)}
"""Device classes of USB adapters, whose numbers may change."""
_DEVICE = re.compile(r"/dev/[A-Za-z0-9_./:@,+=-]+")
"""Device names that need no quoting in a unit."""
_PLUGGED = "/dev/serial/"
"""Folder of persistent names of USB adapters."""


@dataclass(frozen=True)
class Reach:
    """The devices and addresses that a daemon uses."""

    devices: tuple[str, ...] = ()
    """As `DeviceAllow=` takes them."""
    hosts: tuple[str, ...] | None = ()
    """Addresses; None = any, empty = no network."""
    unknown: tuple[str, ...] = ()
    """Robots with unknown needs: their driver is not ours, or runs code of the user."""


def reach_of_robots(mission: Mission, board: str) -> Reach:
    """Return what the bridge of a board uses. Raises Findings for a manifest that cannot be read."""
    devices: list[str] = []
    hosts: list[str] = []
    unknown: list[str] = []
    anybody = False
    for name in mission.robots_on(board):
        robot = mission.robots[name]
        drivers = load_robot_manifest(robot.manifest, mission.path.parent).drivers()
        if any(driver not in OURS or driver == "python" for driver in drivers):
            unknown.append(name)
            anybody = True
        for link in _links(robot):
            if link.kind == "serial":
                if not _DEVICE.fullmatch(link.host):
                    text = "units allow a device such as /dev/ttyAMA0, of letters, digits and `_ . : @ , + = / -`"
                    raise Findings([mission.positions.finding(("robots", name), f"{text}, got {link.host!r}")])
                devices += _allowed(link.host)
            elif (host := _peer(link)) is None:
                anybody = True
            else:
                hosts.append(host)
    return Reach(tuple(dict.fromkeys(devices)), None if anybody else tuple(dict.fromkeys(hosts)), tuple(unknown))


def reaches_machines(mission: Mission, board: str) -> bool:
    """Whether the router of a board is linked to others, or speaks to Comm nodes."""
    others = [other for name, other in mission.boards.items() if name != board]
    own = mission.boards[board].address if board in mission.boards else ""
    gateway = mission.gateway is not None and mission.gateway.board == board
    return bool(own) or gateway or any(other.address for other in others)


def _links(robot: Robot) -> Iterator[LinkAddress]:
    forward = (robot.forward,) if isinstance(robot.forward, str) else robot.forward
    for text in (robot.link, *forward):
        try:
            yield LinkAddress.parse(text)
        except LinkAddressError:  # none, or its driver's own
            continue


def _allowed(device: str) -> tuple[str, ...]:
    if device.startswith(_PLUGGED):
        return ("char-ttyUSB", "char-ttyACM")
    return next((kinds for begin, kinds in _BUSES.items() if device.startswith(begin)), (device,))


def _peer(link: LinkAddress) -> str | None:
    """Return the address of a link's other end; None if it is not known: it listens to all, or dials a host name."""
    if link.host == "localhost":
        return link.host
    try:
        address = ipaddress.ip_address(link.host)
    except ValueError:
        return None
    if address.is_loopback:
        return "localhost"
    return None if link.kind in ("udpin", "tcpin") else str(address).partition("%")[0]  # systemd knows no zones


def files_of(mission: Mission, board: str) -> dict[str, Path]:
    """Return the files that a board needs by their path relative to the mission file.

    Raises Findings for what cannot be read, or is not below the mission file's folder.
    """
    folder = mission.path.resolve().parent
    found = {mission.path.name: mission.path.resolve()}
    if elsewhere := outside(mission, board):
        raise Findings(elsewhere)
    for _, path in _named(mission, board):
        found[str(path.resolve().relative_to(folder))] = path.resolve()
    return dict(sorted(found.items()))


def outside(mission: Mission, board: str) -> list[Finding]:
    """Return a finding for each reference to a file outside the mission file's folder.

    Raises Findings for what cannot be read.
    """
    folder = mission.path.resolve().parent
    found: dict[Steps, Finding] = {}
    for where, path in _named(mission, board):
        path = path.resolve()
        if where not in found and not path.is_relative_to(folder):
            text = f"{path} is not below the mission file, whose folder is what a board gets: put it there"
            found[where] = mission.positions.finding(where, text)
    return list(found.values())


def secrets_of(mission: Mission, board: str) -> list[str]:
    """Return the files with passphrases that the robots of a board need, as the mission names them."""
    robots = map(mission.robots.__getitem__, mission.robots_on(board))
    return [robot.signing.passphrase_file for robot in robots if robot.signing is not None]


def _named(mission: Mission, board: str) -> Iterator[tuple[Steps, Path]]:
    for agent in mission.agents_on(board):
        where = ("agents", agent, "program")
        for source in _sources(mission, agent):
            yield where, source
            for beside in sorted(source.parent.glob("*.asl")):  # a program may include them at run time
                if beside.is_file() and not beside.name.endswith("_test.asl"):
                    yield where, beside
    for name, robot in mission.robots.items():  # of all: agents and access rules need to know others' actions
        for one in (robot.manifest,) if isinstance(robot.manifest, str) else robot.manifest:
            if (path := mission.relative(one)).is_file():  # else it is the name of one that ships
                yield ("robots", name, "manifest"), path
        if robot.board == board:
            yield from _plans(mission, name, robot)


def _plans(mission: Mission, name: str, robot: Robot) -> Iterator[tuple[Steps, Path]]:
    """Yield the plan files that programs name for a robot; `argosy check` reports those that cannot be used."""
    manifest = load_robot_manifest(robot.manifest, mission.path.parent)
    for agent in mission.agents_of(name):
        if agent not in mission.agents:
            continue
        try:
            survey = read_survey(compose(mission, agent), SourcePaths()).survey
        except (Findings, SyntaxErrors, OSError, ValueError):  # reported with the program's own board
            continue
        for plan in named_plans(survey, manifest):
            with suppress(BadPlan):
                if (path := find_plan(mission.path.parent, plan.name)).is_file():
                    yield ("agents", agent, "program"), path


def _sources(mission: Mission, agent: str) -> list[Path]:
    """Return the source files of an agent's program."""
    found = [mission.relative(mission.agents[agent].program)]

    def load(path: str) -> Program:
        found.append(Path(path))
        return parse_file(path)

    try:
        compile_program(compose(mission, agent), load)
    except SyntaxErrors as errors:
        raise Findings(errors.findings) from None
    except DirectiveError as error:
        where = error.position
        raise Findings([Finding(where.file, where.line, where.column, error.message)]) from None
    return found
