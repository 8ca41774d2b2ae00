"""Waiting with a bound."""

import asyncio
from contextlib import suppress

import pytest

from commd.common.tasks import Tasks, wait_at_most


async def test_a_loop_of_waits_ends_when_it_is_cancelled_with_its_event() -> None:
    event = asyncio.Event()

    async def forever() -> None:
        while True:
            event.clear()
            await wait_at_most(event, 60.0)

    for turns in range(6):  # the event comes so many turns of the loop before the cancel
        task = asyncio.create_task(forever())
        await asyncio.sleep(0)
        event.set()
        for _ in range(turns):
            await asyncio.sleep(0)
        task.cancel()
        done, _ = await asyncio.wait([task], timeout=5)
        assert done, f"cancelled {turns} turns after the event, it goes on"


async def test_tasks_end_although_one_forgets_that_it_was_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.common.tasks.WARN_AGAIN", 0.05)

    async def forgets() -> None:
        with suppress(asyncio.CancelledError):
            await asyncio.Event().wait()
        await asyncio.Event().wait()

    tasks = Tasks("forgetting")
    tasks.spawn(forgets())
    tasks.spawn(asyncio.sleep(60))
    await asyncio.sleep(0)
    await tasks.end()
    assert len(tasks) == 0
