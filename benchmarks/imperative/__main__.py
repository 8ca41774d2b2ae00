"""Start one of the programs as a member of its mission, with the values that an agent would have as beliefs.

python -m benchmarks.imperative rescuer MISSION rescuer1 tcp/127.0.0.1:7447 height=10 'peers=["rescuer2"]' ...
"""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import suppress
from importlib import import_module
from typing import Any

from commd.client import join

PATIENCE = 60.0
"""Wall seconds without `commd` or router after which a program gives up."""


async def live(program: str, file: str, name: str, router: str, *settings: str) -> int:
    """Run a program to its end. Returns its exit code; those that serve a team have none."""
    values: dict[str, Any] = {}
    for setting in settings:
        key, _, value = setting.partition("=")
        values[key] = json.loads(value)
    run = import_module(f"benchmarks.imperative.{program}").run
    async with join(name, mission=file, router=router, patience=PATIENCE) as me:
        print(name, "up")
        return 0 if await run(me, **values) else 1


if __name__ == "__main__":
    with suppress(KeyboardInterrupt):
        sys.exit(asyncio.run(live(*sys.argv[1:])))
