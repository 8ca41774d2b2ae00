"""What the daemons of a board reach besides its socket: devices and addresses, as far as the mission says.

Units allow what is needed and nothing else; what cannot be known, for a driver of somebody else, is said.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterator
from dataclasses import dataclass

from bridged.bridge.manifest_loader import load_robot_manifest
from bridged.drivers import OURS
from bridged.drivers.mavlink.transport.address import LinkAddress, LinkAddressError
from schemas.files.findings import Findings
from schemas.mission.model import Mission, Robot

_BUSES = {"/dev/ttyUSB": ("char-ttyUSB",), "/dev/ttyACM": ("char-ttyACM",)}
"""Devices that are plugged in: another one of the kind may have the number after a while."""
_DEVICE = re.compile(r"/dev/[A-Za-z0-9_./:@,+=-]+")
"""What may stand in a unit as it is: no blanks, no lines, no specifiers of systemd."""
_PLUGGED = "/dev/serial/"
"""Where such a device has a name that lasts."""
_ON_THE_BUS = "zenoh"
"""The driver whose robots are reached by the board's socket."""


@dataclass(frozen=True)
class Reach:
    """What a daemon reaches."""

    devices: tuple[str, ...] = ()
    """As `DeviceAllow=` takes them."""
    hosts: tuple[str, ...] | None = ()
    """Addresses; None = whoever there is, empty = no network."""
    unknown: tuple[str, ...] = ()
    """Robots of which nobody can say what they need: their driver is no one of ours, or has code of the user's."""


def robots_of(mission: Mission, board: str) -> dict[str, Robot]:
    """Return the robots that a board serves."""
    return {name: robot for name, robot in mission.robots.items() if robot.board == board}


def agents_of(mission: Mission, board: str) -> list[str]:
    """Return the agents that live on a board."""
    return [name for name, agent in mission.agents.items() if agent.board == board]


def reach_of_robots(mission: Mission, board: str) -> Reach:
    """Return what the bridge of a board reaches. Raises Findings for a manifest that cannot be read."""
    devices: list[str] = []
    hosts: list[str] = []
    unknown: list[str] = []
    anybody = False
    for name, robot in robots_of(mission, board).items():
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
    """Who is at the other end of a link, None if that may be anybody: one that listens for all, or calls by a name."""
    if link.host == "localhost":
        return link.host
    try:
        address = ipaddress.ip_address(link.host)
    except ValueError:
        return None
    if address.is_loopback:
        return "localhost"
    return None if link.kind in ("udpin", "tcpin") else str(address).partition("%")[0]  # systemd knows no zones
