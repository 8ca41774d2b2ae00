"""What an agent sleeps on: woken by what comes, or at its time, with one timer that is moved as little as possible."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

from agentd.runtime.wakeup_timer import WakeupTimer


def in_time(main: Callable[[], Coroutine[Any, Any, Any]]) -> Any:
    return asyncio.run(asyncio.wait_for(main(), 240))


def test_it_wakes_when_something_comes() -> None:
    async def main() -> None:
        wake = WakeupTimer()
        sleeping = asyncio.create_task(wake.wait(None))
        await asyncio.sleep(0)
        assert wake.asleep
        wake.set()
        assert not wake.asleep
        await sleeping

    in_time(main)


def test_what_came_before_it_sleeps_is_not_slept_through() -> None:
    async def main() -> None:
        wake = WakeupTimer()
        wake.set()
        await wake.wait(None)
        wake.clear()
        assert not wake.asleep

    in_time(main)


def test_it_wakes_at_its_time_and_not_before() -> None:
    async def main() -> None:
        wake, loop = WakeupTimer(), asyncio.get_running_loop()
        begun = loop.time()
        await wake.wait(0.05)
        assert loop.time() - begun >= 0.049

    in_time(main)


def test_a_timer_that_is_due_earlier_stays_and_wakes_nobody() -> None:
    async def main() -> None:
        wake, loop = WakeupTimer(), asyncio.get_running_loop()
        begun = loop.time()
        sleeping = asyncio.create_task(wake.wait(0.02))
        await asyncio.sleep(0)
        alarm = wake._alarm
        wake.within(0.1)
        assert wake._alarm is alarm
        await sleeping
        assert loop.time() - begun >= 0.099

    in_time(main)


def test_a_timer_that_would_be_too_late_is_set_anew() -> None:
    async def main() -> None:
        wake = WakeupTimer()
        sleeping = asyncio.create_task(wake.wait(1000))
        await asyncio.sleep(0)
        wake.within(0.02)
        await sleeping

    in_time(main)


def test_without_a_time_only_what_comes_wakes_it() -> None:
    async def main() -> None:
        wake = WakeupTimer()
        sleeping = asyncio.create_task(wake.wait(0.02))
        await asyncio.sleep(0)
        wake.within(None)
        await asyncio.sleep(0.1)
        assert wake.asleep
        wake.set()
        await sleeping

    in_time(main)


def test_closed_it_leaves_no_timer() -> None:
    async def main() -> None:
        wake = WakeupTimer()
        sleeping = asyncio.create_task(wake.wait(0.02))
        await asyncio.sleep(0)
        wake.close()
        await asyncio.sleep(0.1)
        assert wake.asleep
        sleeping.cancel()

    in_time(main)
