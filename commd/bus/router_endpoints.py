"""Where the routers of a fleet's boards listen and whom they dial (design section 7).

One of each pair of boards dials the other: the later one in the mission file the earlier one, or the other way round if
the earlier one has no address.
"""

from __future__ import annotations

import errno
import re
import socket
from collections.abc import Sequence
from contextlib import closing
from typing import Literal

from schemas.files.units import host_and_port
from schemas.mission.model import DEFAULT_PORT, Mission

_TCP = re.compile(r"(?:tcp|tls)/\[?([^\]/]+?)\]?:(\d+)")


def router_of(
    mission: Mission, board: str, endpoint: str, protocol: Literal["tcp", "tls"] = "tcp"
) -> tuple[list[str], list[str]]:
    """Return where the router of `board` listens besides its own daemons' `endpoint`, and which routers it dials.

    Without an address in the mission it listens for nobody else, on whatever network this machine is.
    """
    boards = list(mission.boards)
    own = endpoint_of(mission, board, protocol)
    listen = [own] if own and own != endpoint else []
    place = boards.index(board) if board in boards else 0
    others = boards[:place] if own else [other for other in boards if other != board]
    return listen, list(dict.fromkeys(one for other in others if (one := endpoint_of(mission, other, protocol))))


def endpoint_of(mission: Mission, board: str, protocol: Literal["tcp", "tls"]) -> str:
    """Return where other machines reach the router of a board, nothing if the mission does not say it."""
    address = mission.boards[board].address if board in mission.boards else ""
    if not address:
        return ""
    host, port = host_and_port(address, DEFAULT_PORT)
    return f"{protocol}/{host}:{port}"


def addresses_to_come(endpoints: Sequence[str]) -> list[str]:
    """Return those of the endpoints whose address is none of this machine, or not yet: a network that is not up.

    Raises OSError for one that somebody else listens at.
    """
    return [endpoint for endpoint in endpoints if not _is_here(endpoint)]


def _is_here(endpoint: str) -> bool:
    """Whether this machine can listen at an endpoint now. What is not TCP is for Zenoh to find out."""
    found = _TCP.fullmatch(endpoint)
    if found is None:
        return True
    try:
        family, kind, _, _, address = socket.getaddrinfo(found[1], int(found[2]), type=socket.SOCK_STREAM)[0]
        with closing(socket.socket(family, kind)) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            probe.listen(1)
    except socket.gaierror:
        return False
    except OSError as error:
        if error.errno == errno.EADDRNOTAVAIL:
            return False
        raise OSError(error.errno, f"cannot listen at {endpoint}: {error.strerror}") from None
    return True
