"""Lets the scout survey one sector after another, and ends its mission when all is known."""

import asyncio
import sys

from commd.client import join, parse, write


async def plan(mission: str, router: str = "") -> None:
    sectors = ["north", "east", "south", "atlantis"]
    async with join("planner", mission=mission, router=router) as me:
        for sector in sectors:
            await me.send("scout", "achieve", parse(f"survey({sector})"))  # on disk when this returns
        async for message in me.messages():
            print(message.sender, "says", write(message.content), flush=True)
            sectors.pop()
            if not sectors:
                me.done(message)  # a loop that is left has to say so of its last message
                break
        await me.send("scout", "achieve", parse("stand_down"))


asyncio.run(plan(*sys.argv[1:]))
