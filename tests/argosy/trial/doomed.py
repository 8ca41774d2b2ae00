"""A process with a session that is going to be killed: `python -m tests.argosy.trial.doomed ENDPOINT`."""

import asyncio
import sys

from commd.bus.bus import Bus, Query, open_bus
from schemas.wire.records import Action, ActionStatus
from tests.support.buses import FLEET

TOKEN = f"argosy/{FLEET}/doomed"
SERVED = f"argosy/{FLEET}/uav/action/*"


def serve_forever(bus: Bus) -> None:
    """Declare a token, and answer queries with one reply but never to the end."""

    async def serve(query: Query[Action]) -> None:
        query.reply(ActionStatus(id="1", state="running"))
        await asyncio.Event().wait()

    bus.serve(SERVED, Action, serve)
    bus.token(TOKEN)


async def main(endpoint: str) -> None:
    """Do it until killed."""
    async with open_bus(endpoint, fleet=FLEET, name="doomed", daemon="agentd") as bus:
        serve_forever(bus)
        print("ready", flush=True)
        await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main(sys.argv[1]))
