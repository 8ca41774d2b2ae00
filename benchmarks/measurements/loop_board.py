"""Run the board of the decision loop: router, bridge, agent, and a robot that is this process.

The robot speaks on Zenoh keys (driver `zenoh`), without the physics of a vehicle: it puts `ping`, its agent answers
each `+ping(N)` by the action `pong(N)` and, when that has succeeded, by `seen(N)`.

`python -m benchmarks.measurements.loop_board ENDPOINT SIZE` is the other side of bare exchanges through the same
router, the least cost of those in the loop: it puts back each put, and answers each query. It has a session and two
callbacks: no asyncio, no records, no checks.
"""

from __future__ import annotations

import json
import queue
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import zenoh

from benchmarks.processes import BenchmarkFailed, Watched, watched
from benchmarks.serving import Site
from commd.bus.session import session_config
from schemas.wire import keys

PATIENCE: Final = 20.0
"""Seconds for anything that takes milliseconds."""

_MISSION: Final = """\
mission: loop
agents:
  thinker: {{program: loop.asl, robot: bot{restart}}}
robots:
  bot: {{manifest: loop.toml, prefix: robot}}
"""
_MANIFEST: Final = """\
[robot]
driver = "zenoh"

[percepts.ping]
source = "ping"
args = ["n"]

[percepts.tick]                           # the number of a change, and how many there will be
source = "tick"
args = ["n", "of"]

[percepts.mark]                           # the same, each beside those before for a while
source = "mark"
args = ["n", "of"]
buf = "add"
ttl = "0.2s"

[percepts.run]
source = "run"
args = ["n"]

[actions.pong]
params = [{name = "n", type = "int"}]
topic = "pong"
deadline = "5s"
motion = false

[actions.seen]
params = [{name = "n", type = "int"}]
topic = "seen"
deadline = "5s"
motion = false
"""
PROGRAM: Final = """\
next(1).
missing(0).

+ping(N) <- pong(N); seen(N).

+tick(N, Of) <- !counted(N, Of).
+mark(N, Of) <- !counted(N, Of).
+!counted(N, N) : next(N) <- .print("all up to ", N); -+next(N + 1).
+!counted(N, Of) : next(N) <- -+next(N + 1).
+!counted(N, Of) : next(M) & missing(K) <- .print("came ", N, " instead of ", M); -+next(N + 1); -+missing(K + N - M).
+run(N) : next(M) & missing(K) <- .print("run ", N, " is at ", M, " without ", K); -+next(1); -+missing(0).
"""


def payload(number: int, of: int = 0) -> bytes:
    """Return the payload of a sample of the robot."""
    return json.dumps({"n": number, "of": of} if of else {"n": number}).encode()


class Receiver:
    """The numbers that arrive on a key of the robot, each with its monotonic time in ns."""

    def __init__(
        self, session: zenoh.Session, key: str, read: Callable[[Any], int] = lambda record: int(record["n"])
    ) -> None:
        self._came: queue.SimpleQueue[tuple[int, int]] = queue.SimpleQueue()

        def heard(sample: zenoh.Sample) -> None:
            now = time.monotonic_ns()
            self._came.put((read(json.loads(sample.payload.to_bytes())), now))

        self._subscriber = session.declare_subscriber(key, heard)

    def when(self, number: int, patience: float = PATIENCE) -> int | None:
        """Return when a number came, None if it did not within so many seconds; others before it are passed over."""
        until = time.monotonic() + patience
        while (left := until - time.monotonic()) > 0:
            try:
                came, at = self._came.get(timeout=left)
            except queue.Empty:
                return None
            if came == number:
                return at
        return None

    def close(self) -> None:
        """Listen no more: until then the process does not end."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


@dataclass
class Board:
    """What runs, and the robot's session."""

    session: zenoh.Session
    endpoint: str
    router: Watched
    bridge: Watched
    agent: Watched
    pong: Receiver
    seen: Receiver
    status: Receiver

    def put(self, source: str, number: int, of: int = 0) -> None:
        """Publish a sample of the robot."""
        self.session.put(f"robot/{source}", payload(number, of), encoding="application/json")

    def last_words(self) -> str:
        """Return the last output of the daemons, for an error."""
        return "\n".join(line for one in (self.bridge, self.agent) for _, line in one.output[-5:])


@contextmanager
def board(*, kept: bool = True) -> Iterator[Board]:
    """Run router, bridge and agent while the block lasts. Raises BenchmarkFailed.

    `kept`: the agent is kept on disk, which is the default of a mission.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        (folder / "loop.toml").write_text(_MANIFEST)
        site = Site.written(folder, _MISSION.format(restart="" if kept else ", on_restart: fresh"), loop=PROGRAM)
        endpoint, router = site.router, site.serve(stack, "commd")
        bridge = site.serve(stack, "bridged")
        agent = site.serve(stack, "agentd", ready="bridge_up")
        session = stack.enter_context(zenoh.open(session_config("client", endpoint, "robot")))
        pong, seen = Receiver(session, "robot/pong"), Receiver(session, "robot/seen")
        status = Receiver(session, keys.status("loop", "thinker", "pong"), _succeeded)
        for one in (pong, seen, status):
            stack.callback(one.close)
        made = Board(session, endpoint, router, bridge, agent, pong, seen, status)
        _until_it_answers(made)
        yield made


def _succeeded(record: Any) -> int:
    """Return the number of an action that has succeeded, 0 for other statuses."""
    return int(record["parameters"][0]) if record["state"] == "succeeded" else 0


def _until_it_answers(board: Board) -> None:
    for number in range(-20, 0):
        board.put("ping", number)
        if board.seen.when(number, 1.0) is not None:
            return
    raise BenchmarkFailed(f"the agent does not answer; last:\n{board.last_words()}")


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
    with watched("raw", "-m", "benchmarks.measurements.loop_board", endpoint, str(sizes.status)) as other:
        other.wait_for("ready")
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
