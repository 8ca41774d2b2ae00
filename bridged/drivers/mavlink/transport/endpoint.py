"""What stands under a MAVLink link: the parts that sockets and serial lines have in common."""

import asyncio
import os
import socket
from collections.abc import Awaitable, Callable, Iterator
from contextlib import suppress
from typing import NamedTuple, Protocol

from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.link_peers import LinkCounters, Peer

MAX_QUEUED_BYTES = 65536
"""Bytes that may wait for one peer; about 1500 packets, 11 s of a 57600 baud line."""

MAX_FOREIGN_BYTES = 4096
"""Bytes that may wait at a vehicle's link for more of a ground station's packets to be let in: ours come next, soon."""

BACKOFF_S = (0.2, 5.0)
"""First and longest pause between two attempts to open a link again, in wall seconds."""
STEADY_S = 5.0
"""Wall seconds that a link must have been open for the next attempt to come soon again."""


class Switchboard(Protocol):
    """What an endpoint needs of its link."""

    address: LinkAddress
    counters: LinkCounters

    def add_peer(self, key: object, label: str, write: Callable[[bytes], bool]) -> Peer: ...
    def find_peer(self, key: object) -> Peer | None: ...
    def drop_peer(self, key: object) -> None: ...
    def received(self, peer: Peer, data: bytes, *, datagram: bool) -> None: ...
    def set_state(self, up: bool, why: str) -> None: ...


class Endpoint:
    """What carries a link's bytes."""

    async def close(self) -> None:
        """Frees the socket or the device."""
        raise NotImplementedError


class Connection(NamedTuple):
    """A TCP connection or a serial line that is open now."""

    lost: asyncio.Future[str]  # done when it is gone, with the reason in words
    close: Callable[[], None]


def in_words(error: OSError) -> str:
    """The reason without its number, which says nothing to people."""
    if isinstance(error, socket.gaierror):
        return "the host name is not known"
    return (os.strerror(error.errno) if error.errno else str(error)).lower()


def _backoff() -> Iterator[float]:
    pause, longest = BACKOFF_S
    while True:
        yield pause
        pause = min(2 * pause, longest)


class Supervised(Endpoint):
    """Keeps one connection open: whenever it is lost it is opened again, with backoff."""

    def __init__(
        self, link: Switchboard, connect: Callable[[], Awaitable[Connection]], opened: Connection | None = None
    ) -> None:
        """`opened` is the first connection if it is there already."""
        self._link = link
        self._connect = connect
        self._present = opened
        self._task = asyncio.create_task(self._keep_open(), name=f"link {link.address}")

    async def _keep_open(self) -> None:
        loop, pauses = asyncio.get_running_loop(), _backoff()
        while True:
            try:
                connection = self._present = self._present or await self._connect()
            except TimeoutError:
                self._link.set_state(False, "no answer")
            except OSError as error:
                self._link.set_state(False, in_words(error) if error.errno else str(error))
            else:
                opened_at = loop.time()
                self._link.set_state(True, "open")
                why = await connection.lost
                self._present = None
                if loop.time() - opened_at > STEADY_S:
                    pauses = _backoff()
                self._link.counters.reopened += 1
                self._link.set_state(False, why)
            await asyncio.sleep(next(pauses))

    async def close(self) -> None:
        self._task.cancel()
        if self._present is not None:
            self._present.close()
        with suppress(asyncio.CancelledError):
            await self._task
