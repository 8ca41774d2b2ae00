"""A look at the bus from within a board: answers lines of JSON on stdin with lines of JSON on stdout, till stdin ends.

Asked `["mind", FLEET, AGENT]` it tells the agent's beliefs, `["alive", FLEET]` the tokens that are there,
`["boxes", FLEET]` what waits at every `commd` that answers. What does not answer is told as null.
"""

import asyncio
import json
import sys
from typing import Any

import msgspec

from commd.bus.bus import Bus, open_bus
from commd.bus.errors import BusClosed
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from schemas.wire.records import Mailboxes

PATIENCE = 3.0
"""Seconds for one answer."""


async def answer(bus: Bus, what: str, *names: str) -> Any:
    """Answer one question."""
    match what, names:
        case "mind", (agent,):
            async for reply in bus.query(keys.mind(bus.fleet, agent), None, MindView, PATIENCE):
                if reply.record is not None:
                    return [belief.text for belief in reply.record.beliefs]
            return None
        case "alive", ():
            return await bus.tokens(keys.alive(bus.fleet, "*", "*", "*"), PATIENCE)
        case "boxes", ():
            found = {}
            async for boxes in bus.query(keys.mailboxes(bus.fleet, "*"), None, Mailboxes, PATIENCE):
                if boxes.record is not None:
                    found[boxes.record.board] = msgspec.to_builtins(boxes.record)
            return found
    raise ValueError(f"cannot look for {what} {names}")


async def main(fleet: str, endpoint: str) -> None:
    """Answer until stdin ends."""
    loop = asyncio.get_running_loop()
    async with open_bus(endpoint, fleet=fleet, name="look", daemon="test") as bus:
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            try:
                found = await answer(bus, *json.loads(line))
            except BusClosed:
                found = None
            print(json.dumps(found), flush=True)


if __name__ == "__main__":
    asyncio.run(main(*sys.argv[1:]))
