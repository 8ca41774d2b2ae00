"""How often the agents of a daemon are committed, in virtual time."""

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import cast

import pytest

from agentd.persistence.checkpoint import AgentRows, Checkpoint
from agentd.persistence.group_commit import Batch, GroupCommit
from tests.support.buses import virtual_test


class Disk:
    """Takes `takes` virtual seconds for each save, as the checkpoint and the thread that writes it."""

    def __init__(self, takes: float) -> None:
        self.takes = takes
        self.began: list[float] = []

    def submit(self, work: Callable[[], None]) -> None:
        loop = asyncio.get_running_loop()
        self.began.append(round(loop.time(), 6))
        loop.call_later(self.takes, work)

    def save(self, savings: Mapping[str, AgentRows], soft: bool) -> None:
        assert savings

    def shorten_log(self) -> None:
        pass


class Busy:
    """An agent that always has something to be saved within `within` seconds, and `messages` to be sent."""

    atomic = False

    def __init__(self, commits: GroupCommit, within: float, messages: int) -> None:
        self.counters: Counter[str] = Counter()
        self._commits, self._within, self._messages = commits, within, messages

    def look(self) -> None:
        self._commits.ask(self, self._within)

    def capture(self, batch: Batch, now: float) -> bool:
        batch.savings["bob"] = AgentRows()
        batch.members.append(self)
        batch.messages += self._messages
        asyncio.get_running_loop().call_soon(self.look)
        return True

    def add_mail(self, batch: Batch) -> None:
        pass


@pytest.mark.parametrize(
    ("takes", "within", "messages", "apart"),
    [
        (0.0005, 0.005, 0, 0.005),
        (0.0005, 0.02, 0, 0.02),
        (0.004, 0.005, 0, 0.008),
        (0.015, 0.005, 0, 0.02),
        (0.03, 0.005, 0, 0.03),
        (0.0005, 0.005, 2, 0.005),
        (0.0005, 0.005, 5, 0.01),
        (0.0005, 0.005, 500, 0.02),
    ],
)
@virtual_test
async def test_a_commit_follows_when_it_may_and_waits_for_a_slow_disk_and_for_mail_that_flows(
    takes: float, within: float, messages: int, apart: float
) -> None:
    disk = Disk(takes)
    commits = GroupCommit(cast(Checkpoint, disk), cast(Executor, disk))
    busy = Busy(commits, within, messages)
    busy.look()
    await asyncio.sleep(1.0)
    assert busy.counters.keys() == {"saved"}
    between = [after - before for before, after in zip(disk.began[1:], disk.began[2:], strict=False)]
    assert between == pytest.approx([apart] * len(between))
    assert len(between) >= 10
