"""The links of a mission's MAVLink robots: which robots share one, its other end, and the ends that this machine binds.

A link in another form belongs to another driver, which reads it itself.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable
from contextlib import ExitStack

from bridged.drivers.mavlink.transport.address import LinkAddress, LinkAddressError
from schemas.files.findings import Finding
from schemas.mission.model import Mission, Robot

MEETING = ("udpin", "tcpin")
"""Kinds of links that several vehicles can dial."""
_PEERS = {"udpin": "udpout", "udpout": "udpin", "tcpin": "tcp", "tcp": "tcpin"}
_ANYWHERE = "0.0.0.0"  # noqa: S104  to compare with, not to bind
_LOOPBACK = {"localhost": "127.0.0.1", "::1": "127.0.0.1", "::": _ANYWHERE}
_ANY_ADDRESS = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104  we call there, we do not bind


def address_of(robot: Robot) -> LinkAddress | None:
    """Return a robot's link; None if it has none, or one of another driver's form."""
    try:
        return LinkAddress.parse(robot.link)
    except LinkAddressError:
        return None


def peer_of(link: LinkAddress, address: str | None = None) -> LinkAddress:
    """Return the other end of a link: on this machine, or on another one than that of `address` (empty: unknown).

    Raises LinkAddressError for a link that has no other end there: a serial line, or one that stays on its machine.
    """
    if link.kind == "serial":
        raise LinkAddressError(str(link), "a simulated robot needs a udpin, udpout, tcp or tcpin link")
    kind, host, listens = _PEERS[link.kind], link.host, link.kind.endswith("in")
    if address is None:
        host = _ANY_ADDRESS.get(host, host) if listens else host
    elif _LOOPBACK.get(host, host).startswith("127."):
        where = f"{link.kind}:{_ANYWHERE}:{link.port}" if listens else f"{link.kind}:HOST:{link.port}"
        raise LinkAddressError(str(link), f"it stays on its board, and the simulator is elsewhere; write `{where}`")
    elif listens and host in _ANY_ADDRESS:
        if not address:
            raise LinkAddressError(str(link), "the simulator is elsewhere, and the robot's board has no `address`")
        host = address
    return LinkAddress.parse(f"{kind}:[{host}]:{link.port}" if ":" in host else f"{kind}:{host}:{link.port}")


def together(mission: Mission) -> list[list[str]]:
    """Return the robots of each bridge: robots that share a link of a board share a bridge, others have their own."""
    groups: dict[tuple[str, str, str], list[str]] = {}
    for name, robot in mission.robots.items():
        key = (robot.board, "link", robot.link) if robot.link else (robot.board, "robot", name)
        groups.setdefault(key, []).append(name)
    return list(groups.values())


def group_of(mission: Mission, name: str) -> list[str]:
    """Return the robots on a robot's link, including itself."""
    return next(group for group in together(mission) if name in group)


def check_links(mission: Mission) -> list[Finding]:
    """Return a finding for each link that is the same as another one, but written differently."""
    findings: list[Finding] = []
    taken: dict[str, LinkAddress] = {}
    for name, robot in mission.robots.items():
        link = address_of(robot)
        if link is None:
            continue
        for other, its in taken.items():
            written = mission.robots[other].link
            if mission.robots[other].board != robot.board:  # another machine, with ports of its own
                continue
            if _collide(link, its) and written != robot.link:
                text = f"`{link}` is the port of robot `{other}` already: robots that share a link write it alike, as "
                findings.append(mission.positions.finding(("robots", name, "link"), f"{text}`{written}`"))
        taken[name] = link
    return findings


def free_links(robots: Iterable[str]) -> dict[str, str]:
    """Return a link for each of these simulated vehicles, at a free port of this machine."""
    links = {}
    with ExitStack() as stack:
        for name in robots:
            probe = stack.enter_context(socket.socket(type=socket.SOCK_DGRAM))
            probe.bind(("127.0.0.1", 0))
            links[name] = f"udpin:127.0.0.1:{probe.getsockname()[1]}"
    return links


def bound_links(mission: Mission, simulators: list[str]) -> dict[LinkAddress, list[str]]:
    """Return the ends of links that processes of a run bind on this machine, each with its robots.

    `simulators` are the robots whose simulator is started.
    """
    bound: dict[LinkAddress, list[str]] = {}
    for name, robot in mission.robots.items():
        link = address_of(robot)
        if link is None:
            continue
        for end in (link, peer_of(link)) if name in simulators else (link,):
            if end.kind in MEETING:
                bound.setdefault(end, []).append(name)
    return bound


def ports_of(mission: Mission) -> set[int]:
    """Return the ports that links of a mission name."""
    links = (address_of(robot) for robot in mission.robots.values())
    return {link.port for link in links if link is not None and link.kind != "serial"}


def _collide(link: LinkAddress, other: LinkAddress) -> bool:
    """Whether two links, written differently, are one."""
    hosts = {_LOOPBACK.get(one.host, one.host) for one in (link, other)}
    same = len(hosts) == 1 or (_ANYWHERE in hosts and link.kind.endswith("in"))
    return (link.kind, link.port) == (other.kind, other.port) and same
