"""The board on which the decision loop is measured: router, bridge, agent, and a robot that is this process.

The robot speaks on Zenoh keys (driver `zenoh`), so that no physics of a vehicle is in the way: it puts `ping`, its
agent answers each `+ping(N)` by the actions `pong(N)` and, when that has succeeded, `seen(N)`.
"""

from __future__ import annotations

import json
import queue
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import zenoh

from benchmarks.processes import BenchmarkFailed, Watched
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
+run(N) : next(M) & missing(K) <- .print("run ", N, " stands at ", M, " without ", K); -+next(1); -+missing(0).
"""


def payload(number: int, of: int = 0) -> bytes:
    """Return what the robot says of itself."""
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
        """Let the robot say something."""
        self.session.put(f"robot/{source}", payload(number, of), encoding="application/json")

    def last_words(self) -> str:
        """Return what the daemons said last, for whoever waits in vain."""
        return "\n".join(line for one in (self.bridge, self.agent) for _, line in one.said[-5:])


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
        agent = site.serve(stack, "agentd", says="bridge_up")
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
