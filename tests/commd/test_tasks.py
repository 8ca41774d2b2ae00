"""Waiting with a bound."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

from commd.tasks import wait_at_most


def bounded(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(work, 30))


def test_a_loop_of_waits_ends_when_it_is_cancelled_with_its_event() -> None:
    async def main() -> None:
        event = asyncio.Event()

        async def forever() -> None:
            while True:
                event.clear()
                await wait_at_most(event, 60.0)

        for turns in range(6):  # the event comes so many turns of the loop before the cancel
            task = asyncio.create_task(forever())
            await asyncio.sleep(0.01)
            event.set()
            for _ in range(turns):
                await asyncio.sleep(0)
            task.cancel()
            done, _ = await asyncio.wait([task], timeout=5)
            assert done, f"cancelled {turns} turns after the event, it goes on"

    bounded(main())
