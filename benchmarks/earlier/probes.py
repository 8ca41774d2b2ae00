"""What is probed in a revision, by means that the earlier one has, too: medians or means, no spreads.

python -m benchmarks.earlier.probes NAME [--quick]     in the folder of that revision; prints `FOUND {...}`
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import msgspec

from benchmarks.crowd.run import BOARD, SERVES, STARTING, mission_of
from benchmarks.loop import flood, latency
from benchmarks.processes import BenchmarkFailed
from benchmarks.routers.load import ROUTER
from benchmarks.spread import percentile
from benchmarks.watched import watched
from commd.bus.bus import open_bus
from schemas.wire import keys
from schemas.wire.records import Action, Health
from tests.support.ports import free_port

FLEET: Final = "bench"
TOGETHER, PUTS = 20, 1000.0
"""Records that a session puts in one go, and in a second."""
Found = dict[str, float]


def loop(quick: bool) -> Found:
    """From the robot's sample to its agent's next action at the robot, microseconds, beside bare exchanges.

    Of an agent that is kept on disk, and of one that is not.
    """
    found: Found = {}
    for name, kept in (("kept", True), ("fresh", False)):
        turns = latency.measure(10 if quick else 200, kept=kept)
        bare = [1.5 * (put + ask) for put, ask in zip(turns.put, turns.ask, strict=True)]
        found |= {name: percentile(turns.seen, 0.5), f"{name}_bare": percentile(bare, 0.5)}
    return found


def crowd(quick: bool) -> Found:
    """A thousand agents of one agentd: seconds until it serves, and its processor time for that."""
    agents = 5 if quick else 1000
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        router, state = f"tcp/127.0.0.1:{free_port()}", str(folder / "state")
        where = ("serve", str(mission_of(folder, agents)), "--router", router, "--board", BOARD, "--state", state)
        commd = stack.enter_context(watched("commd", "-m", "commd", *where))
        commd.says("router board=")
        used, begun = commd.cpu(), time.monotonic()
        agentd = stack.enter_context(watched("agentd", "-m", "agentd", *where))
        agentd.says(SERVES, STARTING)
        taken = time.monotonic() - begun
        return {"agents": agents, "start": taken, "agentd": agentd.cpu(), "commd": commd.cpu() - used}


def fleet(quick: bool) -> Found:
    """Records of a session that serves what agents serve: processor time of it and of its router, microseconds each."""
    return asyncio.run(_fleet(20, 200, 0.2) if quick else _fleet(1000, 4000, 5.0))


async def _fleet(agents: int, records: int, settle: float) -> Found:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with watched("router", "-c", ROUTER, endpoint) as router:
        router.says("ready")
        async with open_bus(endpoint, fleet=FLEET, name="b1", daemon="agentd", stamp=time.time_ns, patience=20) as bus:
            for number in range(agents):
                mind = keys.mind(FLEET, f"a{number}")
                for served in ("", "/two", "/three", "/four"):
                    bus.serve(mind + served, Action, _nothing)
            told = Health(header=bus.header("health"), daemon="agentd", pid=4711, uptime=12.3)
            names = [keys.health(FLEET, f"a{number}", "agentd") for number in range(agents)]
            for name in (*names, *names):  # of a key that is used again
                bus.put(name, told)
            await asyncio.sleep(settle)
            own, of_router = time.process_time(), router.cpu()
            for number in range(records):
                bus.put(names[number % agents], told)
                if number % TOGETHER == TOGETHER - 1:
                    await asyncio.sleep(TOGETHER / PUTS)
            own = time.process_time() - own
            await asyncio.sleep(1.0)
            return {"agents": agents, "put": 1e6 * own / records, "router": 1e6 * (router.cpu() - of_router) / records}


async def _nothing(query: object) -> None:
    """Nobody asks."""


def percepts(quick: bool) -> Found:
    """Percepts that change, through bridge and agent: the processor time of each for one, microseconds."""
    rate = 100.0 if quick else 500.0
    (found,) = flood.measure([rate], "tick", 0.5 if quick else 8.0)
    if not found.complete:
        raise BenchmarkFailed(f"of {found.changes} percepts {found.heard} came")
    used = {name: 1e4 * share / found.made for name, share in found.cpu.items()}
    return {"rate": rate, "agentd": used["agentd"], "bridged": used["bridged"]}


PROBES: Final[dict[str, Callable[[bool], Found]]] = {one.__name__: one for one in (fleet, loop, percepts, crowd)}


def main() -> None:
    """Run one probe."""
    found = PROBES[sys.argv[1]]("--quick" in sys.argv)
    print("FOUND", msgspec.json.encode(found).decode(), flush=True)


if __name__ == "__main__":
    main()
