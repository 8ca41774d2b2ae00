"""The supervisor, on small processes of its own."""

import asyncio
import os
import signal
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from argosy.processes.process_table import Kind, Process
from argosy.processes.supervisor import MAX_LINE, Child, Supervisor
from schemas.wire import log_lines
from schemas.wire.log_lines import LogLine
from tests.support.buses import until

KIND = Kind("thing", lambda setup: [], lambda setup, subject: [])


def script(code: str) -> Process:
    """Return a process that runs a little Python."""
    return Process(KIND, "one", (sys.executable, "-S", "-c", code))


class Supervised:
    """A supervisor, the lines of its processes and those that have ended."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.ended: list[Child] = []
        self.supervisor = Supervisor(lambda child, line: self.lines.append(line.text), self.ended.append)


@pytest.fixture
@asynccontextmanager
async def one() -> AsyncIterator[Supervised]:
    """Close the supervisor at the end of the block."""
    one = Supervised()
    try:
        yield one
    finally:
        await one.supervisor.close()
    assert all(not child.alive for child in one.supervisor.children)


async def test_lines_of_both_outputs_arrive_whole_and_without_what_no_text_is(one: Supervised) -> None:
    code = "import os; os.write(1, b'one\\ntw'); os.write(1, b'o\\n\\n'); os.write(2, b'caf\\xff\\nlast')"
    await one.supervisor.start(script(code))
    await until(lambda: bool(one.ended), "it has ended")
    assert sorted(one.lines) == ["caf\ufffd", "last", "one", "two"]


async def test_a_process_that_writes_without_end_cannot_fill_the_memory(one: Supervised) -> None:
    child = await one.supervisor.start(script("import os\nfor _ in range(300): os.write(1, b'x' * 100_000)"))
    await until(lambda: bool(one.ended), "it has ended")
    assert max(map(len, one.lines)) <= MAX_LINE
    assert len(child.lines) <= 50
    assert any(line.endswith("characters more)") for line in one.lines), "a cut line shows it"


async def test_a_process_that_ends_by_itself_is_dead_and_tells_its_last_error(one: Supervised) -> None:
    code = "import os; os.write(2, b'no such vehicle\\n'); os.write(1, b'bye\\n'); os._exit(7)"
    await one.supervisor.start(script(code))
    await until(lambda: bool(one.supervisor.dead()), "its end is seen")
    assert one.supervisor.dead()[0].how_it_ended() == "ended by itself with exit code 7: no such vehicle"


async def test_the_last_error_that_a_daemon_logged_tells_more_than_what_it_wrote_after_it(one: Supervised) -> None:
    error = log_lines.encode(LogLine(text="the disk is full", level="error"))
    await one.supervisor.start(script(f"import os; os.write(2, {error!r} + b'\\nbye\\n'); os._exit(7)"))
    await until(lambda: bool(one.supervisor.dead()), "its end is seen")
    assert one.supervisor.dead()[0].how_it_ended() == "ended by itself with exit code 7: the disk is full"
    assert one.lines == ["the disk is full", "bye"]


async def test_a_process_that_is_told_to_leave_is_not_dead(one: Supervised) -> None:
    child = await one.supervisor.start(script("import time; print('up', flush=True); time.sleep(60)"))
    await until(lambda: one.lines == ["up"], "it is up")
    assert await one.supervisor.leave([child], 10.0, asyncio.Event()) == []
    assert one.supervisor.dead() == []
    assert child.how_it_ended() == "was killed by SIGTERM"


async def test_a_process_that_does_not_leave_is_killed_when_its_time_is_over(one: Supervised) -> None:
    code = "import signal, time; signal.signal(15, signal.SIG_IGN); print('up', flush=True); time.sleep(60)"
    child = await one.supervisor.start(script(code))
    await until(lambda: one.lines == ["up"], "it is up")
    hurry = asyncio.Event()
    hurry.set()  # 1 s instead of 60
    began = time.monotonic()
    assert await one.supervisor.leave([child], 60.0, hurry) == [child]
    assert 0.9 < time.monotonic() - began < 20
    assert child.how_it_ended() == "was killed by SIGKILL"


async def test_a_command_that_does_not_exist_is_said_in_words(one: Supervised) -> None:
    child = await one.supervisor.start(Process(KIND, "one", ("/no/such/program",)))
    await until(lambda: bool(one.ended), "it has ended")
    assert "error: /no/such/program: No such file or directory" in child.how_it_ended()


async def test_each_process_leads_a_group_of_its_own_so_that_ctrl_c_reaches_only_argosy(one: Supervised) -> None:
    child = await one.supervisor.start(script("import time; print('up', flush=True); time.sleep(60)"))
    await until(lambda: one.lines == ["up"], "it is up")
    assert os.getpgid(child.pid) == child.pid
    child.signal(signal.SIGKILL)
    await until(lambda: bool(one.ended), "it has ended")
