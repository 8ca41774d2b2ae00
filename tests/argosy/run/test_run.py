"""`argosy run` from outside: its ends, its exit codes, and that it leaves nothing behind."""

import asyncio
import os
import pty
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest

from argosy.cli.extras import install_command
from argosy.recording.reader import Recording
from argosy.recording.records import TokenSeen
from commd.bus.bus import open_bus
from schemas.wire import keys
from schemas.wire.records import Perception, RunState
from tests.argosy.conftest import DOUBLES, Running, Start, copied, starting
from tests.argosy.recording.files import validated
from tests.argosy.watch.terminal import Terminal
from tests.support.buses import until
from tests.support.ports import free_port
from tests.support.promises import kept


def ended(running: Running) -> tuple[int, str, str]:
    """Wait for the end. Returns exit code, stdout, stderr."""
    running.remember()
    code = running.wait()
    assert running.left_running() == []
    return code, running.stdout, running.stderr


@dataclass(frozen=True)
class Done:
    """A run of the first mission to its end, as it printed it and as it told it on the bus."""

    out: str
    err: str
    report: Path
    told: list[RunState]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    folder, endpoint, told = tmp_path_factory.mktemp("done"), f"tcp/127.0.0.1:{free_port()}", list[RunState]()

    async def listen() -> None:
        async with open_bus(endpoint, fleet="single-uav", name="ears", daemon="argosy") as bus:
            bus.subscribe(keys.run("single-uav", "*"), RunState, lambda key, state: told.append(state))
            await until(lambda: bool(told) and told[-1].phase in ("done", "failed"), "the run ends", 240)

    with starting(folder, endpoint) as start:
        report = folder / "report"
        running = start(copied("single_uav", folder, free_port()), "--speed", "10", "--report", str(report))
        running.until("commd: up")
        asyncio.run(listen())
        code, out, err = ended(running)
    assert code == 0, out + err
    return Done(out, err, report, told)


def test_a_mission_that_is_done_ends_with_0_a_summary_and_a_report(done: Done) -> None:
    for told in (
        "uav1: mode GUIDED",
        "uav: taking off to 5 m",
        "uav: arm_motors(true) failed after more than 0.0 s: Arm: Need Position Estimate",
        "uav: goto(-27.603683,-48.518052,40) succeeded after",
        "single-uav: done",
        "MB at most",
    ):
        assert told in done.out
    assert re.search(r"of a core for \d+\.\d s after the end", done.out)
    assert done.err == ""
    ElementTree.parse(done.report / "track.svg")
    assert "uav1: mode RTL" in (done.report / "mission.log").read_text()
    assert "single-uav: done" in (done.report / "summary.txt").read_text()


def test_all_processes_start_together_but_agents_which_are_born_to_a_bridge_that_is_there(done: Done) -> None:
    lines = done.out.splitlines()
    wanted = ["commd: started", "simulator uav1: started", "bridged uav1: started", "commd: up", "bridged uav1: up"]
    places = [next(i for i, line in enumerate(lines) if text in line) for text in [*wanted, "agentd uav: started"]]
    assert places == sorted(places)


def test_the_run_says_on_the_bus_how_far_it_has_come_and_how_it_ended(done: Done) -> None:
    phases = list(dict.fromkeys(state.phase for state in done.told))
    assert phases in (["starting", "running", "done"], ["running", "done"])
    last = done.told[-1]
    assert (last.why, last.report, last.recording) == ("", str(done.report), str(done.report / "recording.mcap"))
    assert last.mission_time > 20


def test_the_report_has_a_recording_of_the_whole_run(done: Done) -> None:
    path = done.report / "recording.mcap"
    recording = Recording(path)
    assert recording.missing == ""
    assert recording.facts.mission_text == (done.report.parent / "single_uav.yaml").read_text()
    assert (recording.facts.speed, recording.facts.fleet) == (10.0, "single-uav")
    tokens = [(record.key.split("/")[2:5:2], record.alive) for _, record in recording.typed(TokenSeen)]
    assert tokens.index((["uav1", "bridged"], True)) < tokens.index((["uav", "agentd"], True))
    assert (["uav", "agentd"], False) in tokens  # it is there until all others have left
    modes = [one.parameters for _, one in recording.typed(Perception) if one.name == "state"]
    assert modes[0] == ("STABILIZE", True, False)
    assert modes[-1] == ("RTL", True, False)
    assert validated(path) == sum(topic.messages for topic in recording.topics)
    assert f"  recording  {path}: {validated(path)} messages in " in (done.report / "summary.txt").read_text()


def test_a_simulator_killed_in_flight_ends_the_run_within_5_s_with_its_vehicle(start: Start, single_uav: Path) -> None:
    def ending() -> float:
        running = start(single_uav, "--speed", "2")
        running.until("uav1: armed")
        running.family["bridged simulate"].kill()
        killed = time.monotonic()
        code, out, err = ended(running)
        assert code == 1
        assert "error: failed: simulator uav1 was killed by SIGKILL" in err, out + err
        return time.monotonic() - killed

    assert kept(ending, 5.0)


def test_a_process_that_ends_by_itself_is_named_with_its_last_words(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "2", fault="simulator-dies")
    running.until("agentd uav: up")
    running.give_cue()
    code, out, err = ended(running)
    assert code == 1
    assert "  last lines of simulator uav1\n    the sky grew dark\n" in out
    assert out.partition("single-uav: failed")[2].count("the wind was too strong") == 1
    assert "simulator uav1 ended by itself with exit code 3: error: simulator: the wind was too strong" in err


def test_nothing_is_left_when_argosy_itself_is_killed(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "2")
    running.until("uav1: armed")
    running.process.send_signal(signal.SIGKILL)
    running.wait()
    assert len(running.family) >= 4
    assert running.left_running() == []


def test_what_a_process_started_is_not_left_behind(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "10", fault="orphan")
    running.until("uav1: armed")
    assert any("time.sleep(600)" in line for line in running.family)
    running.process.send_signal(signal.SIGTERM)
    assert running.wait() == 128 + signal.SIGTERM
    assert running.left_running() == []


def test_a_bridge_that_does_not_leave_is_killed_after_a_bound(
    start: Start, single_uav: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LEAVE", "5")
    single_uav.write_text(single_uav.read_text() + "bring_home: 4s\n")
    running = start(single_uav, "--speed", "2", fault="stubborn")
    running.until("uav1: armed")
    running.process.send_signal(signal.SIGINT)
    code, out, _ = ended(running)
    assert code == 130
    assert re.search(r"waiting for uav1 \(.* to be disarmed, 4 s left; ctrl-C again leaves", out)
    first = out.index("bridged uav1: has not left after 3 s; it is killed after 5 s")
    assert first < out.index("bridged uav1: did not leave within 5 s and was killed")


@pytest.mark.parametrize("hurried", [False, True])
def test_a_done_mission_has_failed_if_its_vehicle_is_left_armed(
    start: Start, single_uav: Path, monkeypatch: pytest.MonkeyPatch, hurried: bool
) -> None:
    monkeypatch.setenv("LEAVE", "1")
    if not hurried:
        single_uav.write_text(single_uav.read_text() + "bring_home: 4s\n")
    running = start(single_uav, "--speed", "1", fault="done-aloft")
    running.until("argosy: done")
    for told in ("to be disarmed", "ctrl-C again leaves immediately") if hurried else ():
        running.until(told)
        running.process.send_signal(signal.SIGINT)
    code, out, err = ended(running)
    assert code == 1
    why = "left by ctrl-C" if hurried else "`bring_home` ran out after 4 s"
    assert re.search(rf"argosy: uav1 \(.* up\) left armed: {why}\n", out)
    assert re.fullmatch(rf"error: failed: uav1 \(.* up\) left armed: {why}\n", err)
    assert "single-uav: failed: uav1" in out


def test_of_two_runs_that_start_together_at_one_router_one_is_refused_and_does_not_join_the_other(
    start: Start, single_uav: Path
) -> None:
    runs = [start(single_uav, "--speed", "10") for _ in range(2)]
    codes = [ended(running)[0] for running in runs]
    refused, flew = sorted(runs, key=lambda running: len(running.stdout))
    assert sorted(codes) == [0, 1]
    assert (refused.stdout, flew.stderr) == ("", "")
    assert "is in use: is another mission running?" in refused.stderr


def test_a_daemon_that_freezes_ends_the_run_long_before_its_timeout(
    start: Start, single_uav: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LEAVE", "1")
    running = start(single_uav, "--speed", "4", fault="never-done")
    running.until("uav1: armed")
    running.family["agentd serve"].suspend()
    code, out, err = ended(running)
    assert code == 1, out
    assert "error: failed: uav has not answered for 5 s" in err


def test_a_program_that_jason_would_run_runs_and_its_mistakes_are_told(start: Start, tmp_path: Path) -> None:
    (tmp_path / "one.asl").write_text("""\
!begin.
+!begin <- .send(two, tell, hello); !try; +finished.
+!try : battery(_, _, _) <- no_such_action(1); !no_such_goal.
+!try <- no_such_action(2).
-!try[error(E)] <- .print("goes on after ", E).
""")
    (tmp_path / "two.asl").write_text("+hello[source(One)] : state(_, _) <- .print(One).\n")
    mission = tmp_path / "pair.yaml"
    mission.write_text("""\
mission: pair
agents: {one: {program: one.asl}, two: {program: two.asl}}
done: "one: finished"
failed: "two: nobody_ever_believes(this)"
timeout: 1min
""")
    code, out, err = ended(start(mission, real_daemons=True))
    assert code == 0, out + err
    assert "one: goes on after action_failed" in out
    told = [line.partition(": warning: ")[2] for line in err.splitlines()]
    assert "there is no action no_such_action/1" in told
    assert "there is no plan for the goal !no_such_goal/0" in told
    assert "failed: no program ever believes `nobody_ever_believes/1`" in told
    assert "" not in told


def test_a_startup_that_hangs_is_bounded_and_says_what_it_waits_for(
    start: Start, single_uav: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STARTUP_PATIENCE", "5")
    code, _, err = ended(start(single_uav, "--speed", "10", fault="agent-mute"))
    assert code == 1
    assert "error: failed at the start: timed out after 5 s: waited for agentd uav" in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGQUIT])
def test_ctrl_c_or_ctrl_backslash_at_its_start_leaves_nothing(start: Start, single_uav: Path, number: int) -> None:
    running = start(single_uav)
    running.until("commd: started")
    running.process.send_signal(number)
    code, _, err = ended(running)
    assert code == 128 + number, err
    assert "Traceback" not in err


def test_a_terminal_that_goes_away_ends_the_run_and_leaves_nothing_behind(single_uav: Path, endpoint: str) -> None:
    with Terminal([str(DOUBLES), "run", str(single_uav), "--router", endpoint, "--speed", "2"]) as terminal:
        terminal.until(lambda _: b"agentd uav" in terminal.output and b"armed" in terminal.output, "the flight")
        family = psutil.Process(terminal.pid).children(recursive=True)
        assert terminal.hang_up() == 128 + signal.SIGHUP
    assert len(family) == 4
    assert psutil.wait_procs(family, timeout=90)[1] == []


@pytest.mark.parametrize("kind", ["dumb", ""])
def test_a_terminal_that_cannot_be_steered_gets_plain_lines(single_uav: Path, endpoint: str, kind: str) -> None:
    run = [str(DOUBLES), "run", str(single_uav), "--router", endpoint, "--speed", "2"]
    with Terminal(run, TERM=kind) as terminal:
        terminal.shows("commd: up")
        terminal.hang_up()
    assert b"\x1b" not in terminal.output


def test_a_missing_extra_is_one_line_that_says_what_to_install(single_uav: Path, endpoint: str) -> None:
    code = "import sys; sys.modules['rich'] = None; from argosy.__main__ import main; sys.exit(main())"
    terminal, inside = pty.openpty()  # the live view needs one
    command = [sys.executable, "-c", code, "run", str(single_uav), "--router", endpoint]
    environment = {**os.environ, "TERM": "xterm-256color"}
    done = subprocess.run(
        command, stdout=inside, stderr=subprocess.PIPE, env=environment, text=True, timeout=60, check=False
    )
    os.close(inside)
    os.close(terminal)
    assert done.returncode == 2
    assert done.stderr == f"error: argosy needs rich: {install_command('operator')}\n"
