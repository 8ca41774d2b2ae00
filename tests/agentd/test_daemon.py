"""`agentd serve` as a process: what is wrong is said before anything starts, and idle agents use nothing."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import Mock

import pytest

from agentd.daemon import wait_for_disk
from agentd.mind import Mind
from agentd.mind.data.effects import Effect
from agentd.runtime import agent_host
from agentd.runtime.mind_runner import BATCH, SLICE, Ran, reason
from commd.bus.bus import open_bus
from commd.common.clock import Clock
from commd.process.systemd import Unit
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from tests.agentd.daemons import TWO, daemons, mission
from tests.agentd.hosts import Board
from tests.agentd.minds import mind_of
from tests.support.buses import until, virtual_test
from tests.support.processes import running
from tests.support.promises import kept


def test_an_agent_leaves_within_a_second_when_asked_to(tmp_path: Path, endpoint: str) -> None:
    path = mission(tmp_path)

    def leaving() -> float:
        with running("agentd", "serve", path, "b", "--router", endpoint) as agent:
            agent.says("agents=b")
            started = time.monotonic()
            agent.signal(signal.SIGTERM)
            assert agent.ends() == 0
            return time.monotonic() - started

    with running("commd", "serve", path, "--router", endpoint):
        assert kept(leaving, 1.0)


def test_a_second_daemon_of_an_agents_name_does_not_start_and_says_which(tmp_path: Path, endpoint: str) -> None:
    path = mission(tmp_path)
    with daemons(path, endpoint, "b") as (first,):
        first.says("agents=b")
        with running("agentd", "serve", path, "b", "--router", endpoint) as second:
            assert second.ends() == 1
            assert "error: agentd: another agentd serves `b` of fleet `two` already" in second.text


@virtual_test
async def test_a_daemon_with_a_full_disk_waits_for_space_before_its_agents_join(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("agentd.daemon.probe", Mock(side_effect=OSError(28, "No space left on device")))
    unit, stop = Unit().member("agentd"), asyncio.Event()
    waits = asyncio.create_task(wait_for_disk(tmp_path, unit, stop))
    await asyncio.sleep(15)
    assert not waits.done()
    assert [one.message for one in caplog.records if one.name == "agentd"] == [
        f"no agent begins before its state can be kept: {tmp_path}: No space left on device"
    ]
    with pytest.raises(OSError, match="No space left on device"):
        await waits  # its supervisor starts it again
    waits = asyncio.create_task(wait_for_disk(tmp_path, unit, stop))
    await asyncio.sleep(5)
    monkeypatch.undo()
    await waits
    assert not os.listdir(tmp_path)


@pytest.mark.parametrize(
    ("arguments", "text", "programs", "expected"),
    [
        (["c"], TWO, {}, "m.yaml: error: there is no agent `c`; the agents are a, b"),
        (["--board", "pi9"], TWO, {}, "m.yaml: error: board `pi9` has no agents; the agents are a, b"),
        ([], TWO.replace("wait.asl", "wiat.asl"), {}, "m.yaml:4:16: error: agents.b.program: there is no file"),
        ([], TWO.replace("peer(b)", "peer(b"), {}, "m.yaml:3:36: error: in the belief `peer(b`: "),
        ([], TWO.replace("a: enough", "a: enough &"), {}, "m.yaml:5:7: error: `enough &`: "),
        ([], TWO, {"ping": "!start.\n+!start <- .print(1)\n"}, "ping.asl:"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place_before_anything_starts(
    tmp_path: Path, endpoint: str, arguments: list[str], text: str, programs: dict[str, str], expected: str
) -> None:
    path = mission(tmp_path, text, **programs)
    with running("agentd", "serve", path, *arguments, "--router", endpoint) as agent:
        assert agent.ends() == 2
        assert agent.lines[0].startswith(str(tmp_path / expected))
        assert "Traceback" not in agent.text


def test_decisions_are_kept_for_observers_unless_none_are_asked_for(tmp_path: Path, endpoint: str) -> None:
    path = mission(tmp_path, wait='!go. +!go <- .print("here").')

    async def mind() -> MindView:
        async with open_bus(endpoint, fleet="two", name="observer", daemon="test") as bus:
            return await bus.ask_one(keys.mind("two", "b"), None, MindView, 60.0)

    for arguments, events in (("b --fresh", ["+!go"]), ("b --fresh --decisions 0", [])):
        with daemons(path, endpoint, arguments) as (agent,):
            agent.says("[b] here")
            view = asyncio.run(mind())
        assert [decision.event for decision in view.decisions] == events


@pytest.mark.parametrize("delay", [0, 200])
def test_a_program_that_stops_the_team_ends_the_daemon_with_its_code(tmp_path: Path, endpoint: str, delay: int) -> None:
    program = "+jag_shutting_down(T) <- .print(told(T)).\n"
    path = mission(tmp_path, wait=f"!g.\n+!g <- .wait(100); .stopMAS({delay},3).\n{program}")
    with daemons(path, endpoint, "b") as (agent,):
        assert agent.ends() == 3
        assert ("[b] told(200)" in agent.text) == (delay > 0)


def test_included_files_and_their_mistakes_are_those_of_the_program(tmp_path: Path, endpoint: str) -> None:
    path = mission(tmp_path, wait='{ include("more.asl") }\n', more="!g.\n+!g <- .print(included).\n")
    with daemons(path, endpoint, "b") as (agent,):
        agent.says("[b] included")
    (tmp_path / "more.asl").write_text("!g.\n+!g <- .print(.\n")
    with running("agentd", "serve", path, "b", "--router", endpoint) as agent:
        assert agent.ends() == 2
        assert agent.lines[0].startswith(f"{tmp_path}/more.asl:2:")


def test_an_agent_goes_on_when_nobody_reads_its_prints_or_they_cannot_be_shown(tmp_path: Path, endpoint: str) -> None:
    program = '!start.\n+!start <- .print("Höhe"); .wait(100); .print("b"); .wait(100); .stopMAS(0, 3).\n'
    path = mission(tmp_path, "mission: m\nagents:\n  a: {program: speak.asl}\ndone: 'a: x'\n", speak=program)
    command = [sys.executable, "-m", "agentd", "serve", path, "--router", endpoint]
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    with running("commd", "serve", path, "--router", endpoint) as router:
        router.says("router board")
        shown = subprocess.run(command, capture_output=True, timeout=60, env=ascii_only)
        assert (shown.returncode, shown.stdout) == (3, b"[a] H\\xf6he\n[a] b\n"), shown.stderr
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as agent:
            agent.stdout.close()
            _, said = agent.communicate(timeout=60)
        assert b"stops the team" in said
        assert b"defect" not in said


class Laborious(Clock):
    """A clock by which the cycles of a mind take so many seconds each."""

    def __init__(self, mind: Mind, costs: list[float]) -> None:
        super().__init__()
        self.mind, self.costs = mind, costs

    def wall(self) -> float:
        return sum(self.costs[: self.mind.cycle])


@pytest.mark.parametrize(
    ("costs", "cycles"),
    [
        ([0.0] * SLICE, SLICE),
        ([0.5] * SLICE, 1),
        ([0.033] * SLICE, 7),
        ([0.0] * 95 + [0.5] * SLICE, 95 + BATCH),  # light ones before do not make it longer
        ([0.005] * SLICE, 47),
    ],
)
def test_heavy_reasoning_lets_the_event_loop_turn_five_times_a_second(costs: list[float], cycles: int) -> None:
    mind = mind_of("!g. +!g <- !!g.")
    reason(mind, Laborious(mind, costs))
    assert mind.cycle == cycles


async def test_agents_of_one_process_that_are_all_busy_have_the_time_of_a_slice_together(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    shares: dict[str, int] = {}

    def noted(mind: Mind, clock: Clock, share: int, ran: Ran | None = None) -> list[Effect]:
        shares[mind.name] = share
        return reason(mind, clock, share, ran)

    monkeypatch.setattr(agent_host, "reason", noted)

    bus = await board.connect("a")
    agents = [await board.host(name, "!g. +!g <- !!g.", bus=bus) for name in ("a", "b", "c")]
    await board.host("idle", "!g. +!g.", bus=bus)
    await until(lambda: [shares.get(name) for name in "abc"] == [3, 3, 3], "three share a slice, and not the idle one")
    for one in agents[1:]:
        await one.end()
    await until(lambda: shares["a"] == 1, "who is alone has all of it")
    await agents[0].end()
