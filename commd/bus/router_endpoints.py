"""Endpoints at which the routers of a fleet's boards listen, and those that they dial.

Of two boards the later one in the mission file dials the earlier one, or the other way round if that has no address.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import re
import socket
from collections.abc import Sequence
from typing import Literal

from commd.bus.errors import BusClosed
from schemas.files.units import host_and_port
from schemas.mission.model import DEFAULT_PORT, Mission

LOOK_UP_PATIENCE = 3.0
"""Wall seconds that the name service has to find the address of this board."""
log = logging.getLogger("bus")
_TCP = re.compile(r"(?:tcp|tls)/\[?([^\]/]+?)\]?:(\d+)")


def router_of(
    mission: Mission, board: str, endpoint: str, protocol: Literal["tcp", "tls"] = "tcp"
) -> tuple[list[str], list[str]]:
    """Return where the router of `board` listens besides its own daemons' `endpoint`, and which routers it dials.

    Without an address in the mission it listens to this machine only.
    """
    boards = list(mission.boards)
    own = endpoint_of(mission, board, protocol)
    listen = [own] if own and own != endpoint else []
    place = boards.index(board) if board in boards else 0
    others = boards[:place] if own else [other for other in boards if other != board]
    return listen, list(dict.fromkeys(one for other in others if (one := endpoint_of(mission, other, protocol))))


def endpoint_of(mission: Mission, board: str, protocol: Literal["tcp", "tls"]) -> str:
    """Return where other machines reach the router of a board; empty without an address in the mission."""
    address = mission.boards[board].address if board in mission.boards else ""
    if not address:
        return ""
    host, port = host_and_port(address, DEFAULT_PORT)
    return f"{protocol}/{host}:{port}"


async def missing_addresses(endpoint: str, listen: Sequence[str]) -> list[str]:
    """Return those of a router's further endpoints whose address this machine does not have, or not yet.

    Raises BusClosed if another process listens at one, or at its own `endpoint`: Zenoh would wait for it.
    """
    own: list[str] = []
    try:
        missing = await asyncio.wait_for(asyncio.to_thread(_not_here, listen), LOOK_UP_PATIENCE)
        own = await asyncio.to_thread(_not_here, [endpoint]) if missing else []
    except TimeoutError:
        missing = list(listen)
    if own:
        raise BusClosed(f"cannot listen at {endpoint}: no address of this machine")
    for one in missing:
        log.warning("%s is no address of this machine yet: no other board reaches this one until it is", one)
    return missing


def _not_here(endpoints: Sequence[str]) -> list[str]:
    missing = []
    for endpoint in filter(_TCP.fullmatch, endpoints):
        if (probe := open_listener(endpoint, 1)) is None:
            missing.append(endpoint)
        else:
            probe.close()
    return missing


def open_listener(endpoint: str, backlog: int) -> socket.socket | None:
    """Return a socket that listens at a TCP or TLS endpoint; None if this machine does not have the address, or not
    yet.

    `backlog` is the number of connections that the kernel keeps until they are accepted. Raises BusClosed if another
    program listens there.
    """
    found = _TCP.fullmatch(endpoint)
    assert found is not None
    made: socket.socket | None = None
    try:
        family, kind, _, _, address = socket.getaddrinfo(found[1], int(found[2]), type=socket.SOCK_STREAM)[0]
        made = socket.socket(family, kind)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(address)
        made.listen(backlog)
        made.setblocking(False)
    except socket.gaierror:
        return None
    except OSError as error:
        if made is not None:
            made.close()
        if error.errno == errno.EADDRNOTAVAIL:
            return None
        raise BusClosed(f"cannot listen at {endpoint}: {error.strerror}: is another router running there?") from None
    return made
