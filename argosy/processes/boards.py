"""The boards of a mission that runs on one machine: each has a router of its own, on loopback, linked to the others'.

The links have ports apart from those that the daemons of a board use, as the boards of a field network have: to cut a
link cuts no daemon from its board.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from argosy.cli.port_check import in_use
from schemas.mission.model import Mission

_PORT = re.compile(r"(?P<before>.+:)(?P<port>\d+)")
_HIGHEST = 65_535


class NoPort(ValueError):
    """There are not enough free ports for the routers; says from which on it was looked for."""


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
        """What `commd serve` is told: what stands here goes before the addresses of the mission."""
        told = ["--router", self.router, *(["--listen", self.listen] if self.listen else [])]
        return [*told, *(word for endpoint in self.connect for word in ("--connect", endpoint))]


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
    """The endpoints after a router's, as long as nobody listens there."""
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
