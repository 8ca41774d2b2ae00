"""Start one of the programs as a member of its mission, with the values that an agent would have as beliefs.

python -m benchmarks.imperative rescuer MISSION rescuer1 tcp/127.0.0.1:7447 height=10 'peers=["rescuer2"]' ...
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
from contextlib import suppress
from importlib import import_module
from typing import Any

from commd.bus.errors import AlreadyRunning
from commd.client import NotJoined, join
from schemas.files.findings import Findings

PATIENCE = 60.0
"""Wall seconds without `commd` or router after which a program gives up."""


def setting(text: str) -> tuple[str, Any]:
    """Read `height=10`: the value is JSON. Raises ValueError."""
    key, _, value = text.partition("=")
    return key, json.loads(value)


async def live(program: str, mission: str, name: str, router: str, values: dict[str, Any]) -> int:
    """Run a program to its end. Returns its exit code; those that serve a team have none."""
    run = import_module(f"benchmarks.imperative.{program}").run
    async with join(name, mission=mission, router=router, patience=PATIENCE) as me:
        print(name, "up")
        return 0 if await run(me, **values) else 1


def main() -> int:
    """Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.imperative", description=__doc__)
    parser.add_argument("program", choices=("single_uav", "scout", "rescuer"))
    parser.add_argument("mission", help="mission file that has the program as a client")
    parser.add_argument("name", help="of the client")
    parser.add_argument("router", help="Zenoh endpoint of its board")
    parser.add_argument("settings", nargs="*", type=setting, metavar="NAME=JSON")
    args = parser.parse_args()
    try:
        with suppress(KeyboardInterrupt):
            return asyncio.run(live(args.program, args.mission, args.name, args.router, dict(args.settings)))
    except Findings as findings:
        print(findings, file=sys.stderr)
        return 2
    except (AlreadyRunning, NotJoined) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
