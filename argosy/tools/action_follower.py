"""One action by hand, asked for and followed to its end; each status as it comes."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from contextlib import aclosing

from msgspec.structs import replace

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError
from schemas.liveness import ACTION_SILENT, ROUTER_GRACE
from schemas.wire import keys
from schemas.wire.records import Action, ActionStatus, Cancel

AT_MOST = 3600.0
"""Wall seconds of one query; then it is asked again with the same id."""
CANCEL_PATIENCE = 5.0
"""Wall seconds that a bridge has to say what became of an action that is cancelled."""
RETRY = 0.2


class Lost(Exception):
    """How the action ended is not known, and why."""


async def follow(bus: Bus, fleet: str, action: Action) -> AsyncGenerator[ActionStatus, None]:
    """Ask for an action and yield what becomes of it; the last status is final. Raises Lost."""
    loop, key = asyncio.get_running_loop(), keys.action(fleet, action.agent, action.name)
    heard, reason, taken = loop.time(), "nobody answers for it: is its bridge there?", False
    while True:
        try:
            async with aclosing(bus.query(key, action, ActionStatus, AT_MOST)) as replies:
                while True:
                    async with asyncio.timeout(ACTION_SILENT):
                        reply = await anext(replies, None)
                    if reply is None:
                        break
                    if reply.record is None:
                        reason = reply.error
                        continue
                    heard, taken, reason = loop.time(), True, "its answers ended without an outcome"
                    yield reply.record
                    if reply.record.final:
                        return
        except TimeoutError:
            raise Lost(f"nothing was heard of it for {ACTION_SILENT:g} s: its bridge hangs, or is cut off") from None
        except BusClosed as closed:
            reason = str(closed)
        if loop.time() - heard > (ROUTER_GRACE if taken else 0):
            raise Lost(reason)
        if taken:  # asked again it is answered, and never begun anew
            action = replace(action, attempt=action.attempt + 1)
        await asyncio.sleep(RETRY)


async def cancel(bus: Bus, fleet: str, agent: str, identity: str) -> ActionStatus | str:
    """End an action. Returns its final status, or why that is not known."""
    try:
        return await bus.ask_one(keys.cancel(fleet, agent), Cancel(id=identity), ActionStatus, CANCEL_PATIENCE)
    except BusError as error:
        return str(error)
