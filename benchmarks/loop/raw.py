"""Bare Zenoh between two Python processes through the same router: what the exchanges of the loop cost at least.

`python -m benchmarks.loop.raw ENDPOINT` is the other side: it puts back what is put to it, and answers what it is
asked. It has a session, two callbacks and nothing else: no asyncio, no records, no checks.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

import zenoh

from benchmarks.processes import BenchmarkFailed, watched
from commd.bus.session import session_config

PUT, BACK, ASK = "raw/put", "raw/back", "raw/ask"
LONGEST: Final = 600.0
"""Seconds after which the other side ends by itself."""


@dataclass(frozen=True)
class Sizes:
    """Bytes of the loop's records, so that bare exchanges carry as many."""

    sample: int
    perception: int
    action: int
    status: int


class Raw:
    """The asking side."""

    def __init__(self, session: zenoh.Session, sizes: Sizes) -> None:
        self._session, self._sizes = session, sizes
        self._back = session.declare_subscriber(BACK, zenoh.handlers.FifoChannel(16))

    def put_and_back(self) -> int:
        """Put a percept's bytes, and have them put back. Returns nanoseconds."""
        payload = bytes(self._sizes.perception)
        begun = time.monotonic_ns()
        self._session.put(PUT, payload)
        self._back.recv()
        return time.monotonic_ns() - begun

    def ask(self) -> int:
        """Ask with an action's bytes, and be answered with a status's. Returns nanoseconds."""
        payload = bytes(self._sizes.action)
        begun = time.monotonic_ns()
        for reply in self._session.get(ASK, payload=payload):
            if reply.ok is None:
                raise BenchmarkFailed("a bare query was not answered")
            return time.monotonic_ns() - begun
        raise BenchmarkFailed("nobody serves a bare query")

    def close(self) -> None:
        """Listen no more."""
        self._back.undeclare()  # type: ignore[no-untyped-call]


@contextmanager
def raw(endpoint: str, session: zenoh.Session, sizes: Sizes) -> Iterator[Raw]:
    """Run the other side while the block lasts."""
    with watched("raw", "-m", "benchmarks.loop.raw", endpoint, str(sizes.status)) as other:
        other.says("ready")
        made = Raw(session, sizes)
        guard = threading.Timer(LONGEST, session.close)  # what is waited for then does not come any more
        guard.daemon = True
        guard.start()
        try:
            yield made
        finally:
            guard.cancel()
            made.close()


def _echo(endpoint: str, size: int) -> None:
    answer = bytes(size)
    with zenoh.open(session_config("client", endpoint, "raw")) as session:

        def back(sample: zenoh.Sample) -> None:
            session.put(BACK, sample.payload)

        def reply(query: zenoh.Query) -> None:
            with query:
                query.reply(ASK, answer)

        # as the daemons hear: in Zenoh's own thread, without a further one
        declared = (
            session.declare_subscriber(PUT, zenoh.handlers.Callback(back, indirect=False)),
            session.declare_queryable(ASK, zenoh.handlers.Callback(reply, indirect=False)),
        )
        print("ready", flush=True)
        threading.Event().wait(LONGEST)
        del declared


if __name__ == "__main__":
    _echo(sys.argv[1], int(sys.argv[2]))
