"""Be `agentd serve`, and tell when each stretch of its start was done, on the clock that the whole machine shares.

The functions that begin and end a stretch are wrapped here, in this process only; nothing of them is left out.
"""

from __future__ import annotations

import time

_MARKS = [("interpreter", time.monotonic())]

import asyncio  # noqa: E402
import sys  # noqa: E402
from collections.abc import Callable  # noqa: E402
from contextlib import asynccontextmanager  # noqa: E402
from importlib import import_module  # noqa: E402
from typing import Any  # noqa: E402

PREFIX = "PHASE"
LATER = 0.5
"""Seconds after the last stretch at which they are told: the first plan has run by then."""


def mark(name: str) -> None:
    """Note that a stretch is done."""
    _MARKS.append((name, time.monotonic()))


def wrapped(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a function that notes each time it is done."""

    def call(*args: Any, **kwargs: Any) -> Any:
        found = function(*args, **kwargs)
        mark(name)
        return found

    return call


def awaited(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """Return a coroutine function that notes each time it is done."""

    async def call(*args: Any, **kwargs: Any) -> Any:
        found = await function(*args, **kwargs)
        mark(name)
        return found

    return call


def told() -> None:
    """Print what was noted."""
    for name, at in _MARKS:
        print(f"{PREFIX} {name} {at:.6f}", flush=True)


def main() -> int:
    """Run the daemon."""
    import agentd.__main__ as command

    daemon: Any = import_module("agentd.daemon")
    agent_group: Any = import_module("agentd.runtime.agent_group").AgentGroup
    roster: Any = import_module("agentd.runtime.agent_directory").AgentDirectory

    mark("imports")
    open_bus = daemon.open_bus

    @asynccontextmanager
    async def opened(*args: Any, **kwargs: Any) -> Any:
        async with open_bus(*args, **kwargs) as bus:
            mark("session")
            yield bus

    daemon.load_mission = wrapped(daemon.load_mission, "mission")
    daemon.prepare = wrapped(daemon.prepare, "program")
    daemon.open_bus = opened
    daemon.greet = awaited(daemon.greet, "greeting")
    agent_group.add = awaited(agent_group.add, "joining")
    watch = awaited(roster.watch, "roster")

    async def watched(*args: Any) -> None:
        await watch(*args)
        asyncio.get_running_loop().call_later(LATER, told)

    roster.watch = watched
    return command.main(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
