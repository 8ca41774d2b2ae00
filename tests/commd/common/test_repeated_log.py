"""What goes on for long is said again at longer and longer intervals."""

import asyncio

from commd.common.repeated_log import RepeatedLog
from tests.support.buses import virtual_test


@virtual_test
async def test_it_is_said_after_ten_seconds_a_minute_and_then_every_ten_minutes() -> None:
    said: list[float] = []
    reminder = RepeatedLog(said.append)
    await asyncio.sleep(100)
    reminder.begin()
    await asyncio.sleep(2500)
    assert said == [10, 60, 600, 1200, 1800, 2400]


@virtual_test
async def test_nothing_is_said_of_what_is_over_and_the_next_time_begins_anew() -> None:
    said: list[float] = []
    reminder = RepeatedLog(said.append)
    assert reminder.end() is None
    reminder.begin()
    await asyncio.sleep(30)
    assert reminder.end() == 30
    await asyncio.sleep(5000)
    assert said == [10]
    assert not reminder.active
    reminder.begin()
    await asyncio.sleep(11)
    assert said == [10, 10]
