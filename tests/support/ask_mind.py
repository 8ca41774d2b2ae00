"""Ask an agent over its board's socket whether its part of the mission is done: prints `done`, `not yet` or why not.

python ask_mind.py ENDPOINT FLEET AGENT
"""

import asyncio
import sys

from commd.bus.bus import open_bus
from commd.bus.errors import BusClosed
from schemas.wire import keys
from schemas.wire.mind_records import MindView


async def ask(endpoint: str, fleet: str, agent: str) -> str:
    """Return in words what the agent says."""
    try:
        async with open_bus(endpoint, fleet=fleet, name="asks", daemon="test", patience=2.0) as bus:
            async for reply in bus.query(keys.mind(fleet, agent), None, MindView, 2.0):
                if reply.record is None:
                    return reply.error
                return "done" if all(reply.record.done.values()) else "not yet"
    except BusClosed as error:
        return str(error)
    return "nobody answers"


if __name__ == "__main__":
    print(asyncio.run(ask(*sys.argv[1:])))
