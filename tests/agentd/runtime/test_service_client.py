"""How long agents wait for the directory: together no longer than one alone, and in turn while it answers."""

from __future__ import annotations

import asyncio
import time
from typing import Any, cast

import pytest

from agentd.runtime.service_client import AT_ONCE, NotDone, Services
from commd.bus.bus import Bus
from commd.bus.errors import QueryTimeout
from schemas.wire.records import BoardServices, ServiceRequest
from tests.support.promises import in_time


class Directories:
    """The bus, and on it the directory of the board `here`, which takes a time for each answer; others are silent."""

    fleet = "test"

    def __init__(self, takes: float = 0.0) -> None:
        self._takes = takes
        self.asked = 0

    async def ask_one(self, key: str, request: ServiceRequest, kind: Any, seconds: float) -> BoardServices:
        self.asked += 1
        if "/here/" in key:
            await asyncio.sleep(self._takes)
            return BoardServices(board="here")
        await asyncio.sleep(seconds)
        raise QueryTimeout(key, seconds)


def asking(directories: Directories) -> Services:
    return Services(cast(Bus, directories))


@pytest.mark.parametrize("agents", [1, 200])
def test_a_directory_that_does_not_answer_is_given_up_by_all_at_the_same_time(
    agents: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("agentd.runtime.service_client.PATIENCE", 0.5)

    async def body() -> None:
        services = asking(Directories())
        begun = time.monotonic()
        asked = [services.ask("gone", f"a{n % agents}", "search", "s") for n in range(200)]
        failed = await asyncio.gather(*asked, return_exceptions=True)
        assert all(isinstance(one, NotDone) and not one.answered for one in failed)
        assert "the directory of board gone does not answer: " in str(failed[0])
        assert "those before it have had no answer either" in str(failed[-1])
        assert in_time(time.monotonic() - begun, 4), "one after the other they would need 6 s at least"

    asyncio.run(body())


def test_those_who_ask_a_silent_board_hold_up_nobody_who_asks_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.runtime.service_client.PATIENCE", 1000.0)

    async def body() -> None:
        services = asking(Directories())
        in_vain = [asyncio.create_task(services.ask("gone", f"a{n}", "search")) for n in range(2 * AT_ONCE)]
        await asyncio.sleep(0)
        async with asyncio.timeout(120):
            assert (await services.ask("here", "b", "search")).board == "here"
        assert not any(task.done() for task in in_vain)
        for task in in_vain:
            task.cancel()
        await asyncio.gather(*in_vain, return_exceptions=True)

    asyncio.run(body())


def test_a_crowd_is_answered_in_turn_however_long_that_takes_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.runtime.service_client.PATIENCE", 1.0)

    async def body() -> None:
        directories = Directories(takes=0.25)
        services = asking(directories)
        begun = time.monotonic()
        answers = await asyncio.gather(*(services.ask("here", f"a{n}", "join") for n in range(6 * AT_ONCE)))
        assert len(answers) == directories.asked == 6 * AT_ONCE
        assert time.monotonic() - begun > 1.0

    asyncio.run(body())
