"""How many percepts one router takes on: publishers, the router and a subscriber are a process each.

python -m benchmarks.routers.load publish ENDPOINT SESSIONS RATE     puts, a second in all; 0 = as fast as it can
python -m benchmarks.routers.load count ENDPOINT                     counts what comes, a line each half second
"""

from __future__ import annotations

import itertools
import signal
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

import zenoh

from benchmarks.processes import BenchmarkFailed
from benchmarks.watched import Watched, watched
from commd.bus.session import session_config
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import Header, Perception
from tests.support.ports import free_port

FLEET: Final = "bench"
SESSIONS: Final = 20
"""Bridges that tell percepts, each on a session of its own."""
NAMES: Final = 10
"""Percepts that each of them has."""
TICK: Final = 0.01
"""Seconds between two bursts of a publisher."""
SETTLE: Final = 1.5
ROUTER: Final = """\
import sys, time, zenoh
from commd.bus.session import session_config
with zenoh.open(session_config("router", sys.argv[1], "router")):
    print("ready", flush=True)
    time.sleep(600)
"""


@dataclass
class Load:
    """One rate."""

    wanted: float
    """Percepts a second; 0 = as many as could be put."""
    put: float
    came: float
    """A second."""
    router: float
    """Per cent of a core."""
    publisher: float
    subscriber: float

    @property
    def microseconds(self) -> float:
        """Processor time of the router for one percept that came."""
        return 1e4 * self.router / self.came if self.came else 0.0


def payload() -> bytes:
    """A percept as a copter's bridge tells it."""
    header = Header(seq=123_456, stamp=1_763_800_000_000_000_000, source="uav1", boot="0a1b2c3d")
    pose = Perception(header=header, name="global_pos", parameters=(-27.604033, -48.518363))
    return codec(Perception).encode(pose, "json")


def measure(rates: tuple[float, ...], seconds: float) -> list[Load]:
    """Measure one rate after the other, each with processes of its own. Raises BenchmarkFailed."""
    return [_measured(rate, seconds) for rate in rates]


def _measured(rate: float, seconds: float) -> Load:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        router = stack.enter_context(watched("router", "-c", ROUTER, endpoint))
        router.says("ready")
        counter = stack.enter_context(watched("subscriber", "-m", "benchmarks.routers.load", "count", endpoint))
        counter.says("came")
        told = ("-m", "benchmarks.routers.load", "publish", endpoint, str(SESSIONS), f"{rate:g}")
        publisher = stack.enter_context(watched("publisher", *told))
        publisher.says("put")
        time.sleep(SETTLE)
        three = (router, publisher, counter)
        before, begun = [one.cpu() for one in three], time.monotonic()
        time.sleep(seconds)
        took = time.monotonic() - begun
        used = [100 * (one.cpu() - since) / took for one, since in zip(three, before, strict=True)]
        put, came = _a_second(publisher, "put", begun, took), _a_second(counter, "came", begun, took)
        return Load(rate, put, came, *used)


def _a_second(process: Watched, word: str, begun: float, took: float) -> float:
    """Return the rate between the first and the last line of that time, each `WORD COUNT SECONDS`."""
    lines = [line.split() for at, line in process.said if line.startswith(word) and begun <= at <= begun + took]
    if len(lines) < 2:
        raise BenchmarkFailed(f"{process.name} says too little")
    (_, first, since), (_, last, until) = lines[0], lines[-1]
    return (int(last) - int(first)) / (float(until) - float(since))


def _tell(word: str, count: list[int], ended: threading.Event) -> None:
    while not ended.wait(0.25):
        print(word, count[0], time.monotonic(), flush=True)


def _publish(endpoint: str, sessions: int, rate: float, ended: threading.Event) -> None:
    body, count = payload(), [0]
    with ExitStack() as stack:
        publishers = []
        for number in range(sessions):
            session = stack.enter_context(zenoh.open(session_config("client", endpoint, f"bridge{number}")))
            publishers += [
                session.declare_publisher(
                    keys.percept(FLEET, f"uav{number}", f"percept{name}"),
                    congestion_control=zenoh.CongestionControl.DROP,
                )
                for name in range(NAMES)
            ]
        threading.Thread(target=_tell, args=("put", count, ended), daemon=True).start()
        turn = itertools.cycle(publishers)
        begun = time.monotonic()
        while not ended.is_set():
            due = rate * (time.monotonic() - begun) if rate else count[0] + 1000
            while count[0] < due:
                next(turn).put(body)
                count[0] += 1
            if rate:
                time.sleep(TICK)


def _count(endpoint: str, ended: threading.Event) -> None:
    count = [0]

    def came(_: zenoh.Sample) -> None:
        count[0] += 1

    with zenoh.open(session_config("client", endpoint, "counter")) as session:
        session.declare_subscriber(keys.percept(FLEET, "*", "*"), zenoh.handlers.Callback(came, indirect=False))
        _tell("came", count, ended)


def main() -> None:
    """Publish or count, until SIGTERM."""
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    what, endpoint, *more = sys.argv[1:]
    if what == "publish":
        _publish(endpoint, int(more[0]), float(more[1]), ended)
    else:
        _count(endpoint, ended)


if __name__ == "__main__":
    main()
