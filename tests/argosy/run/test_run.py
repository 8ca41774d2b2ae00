"""`argosy run` from outside: its ends, its exit codes, and that it leaves nothing behind."""

from __future__ import annotations

import asyncio
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import psutil
import pytest

from argosy.cli.extras import install_command
from commd.bus.bus import open_bus
from schemas.wire import keys
from schemas.wire.records import RunState
from tests.argosy.conftest import DOUBLES, Running, Start
from tests.argosy.watch.terminal import Terminal
from tests.support.buses import until
from tests.support.promises import kept


def ended(running: Running, seconds: float = 60) -> tuple[int, str, str]:
    """Wait for the end. Returns exit code, stdout, stderr."""
    running.remember()
    code = running.wait(seconds)
    assert running.left_running() == []
    return code, running.stdout, running.stderr


def test_a_mission_that_is_done_ends_with_0_a_summary_and_a_report(
    start: Start, single_uav: Path, tmp_path: Path
) -> None:
    running = start(single_uav, "--speed", "10", "--report", str(tmp_path / "report"))
    running.until("agentd uav: up")
    code, out, err = ended(running)
    assert code == 0, out + err
    assert "uav1: mode GUIDED" in out
    assert "uav: taking off to 5 m" in out
    assert "uav: arm_motors(true) failed after 0.0 s: Arm: Need Position Estimate" in out
    assert "uav: goto(-27.603683,-48.518052,40) succeeded after" in out
    assert "single-uav: done" in out
    assert "MB at most" in out
    assert re.search(r"of a core for \d+\.\d s after the end", out)
    assert err == ""
    ElementTree.parse(tmp_path / "report" / "track.svg")
    assert "uav1: mode RTL" in (tmp_path / "report" / "mission.log").read_text()
    assert "single-uav: done" in (tmp_path / "report" / "summary.txt").read_text()


def test_all_processes_start_together_but_agents_which_are_born_to_a_bridge_that_is_there(
    start: Start, single_uav: Path
) -> None:
    running = start(single_uav, "--speed", "10")
    running.until("agentd uav: up")
    lines = running.stdout.splitlines()
    wanted = ["commd: started", "simulator uav1: started", "bridged uav1: started", "commd: up", "bridged uav1: up"]
    places = [next(i for i, line in enumerate(lines) if text in line) for text in [*wanted, "agentd uav: started"]]
    assert places == sorted(places)


def test_a_simulator_killed_in_flight_ends_the_run_within_5_s_as_its_vehicle_is_no_more(
    start: Start, single_uav: Path
) -> None:
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
    running.process.wait(10)
    assert len(running.family) >= 4
    assert running.left_running(patience=10.0) == []


def test_what_a_process_started_is_not_left_behind(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "10", fault="orphan")
    running.until("uav1: armed")
    assert any("time.sleep(600)" in line for line in running.family)
    running.process.send_signal(signal.SIGTERM)
    assert running.wait(30) == 128 + signal.SIGTERM
    assert running.left_running() == []


def test_ctrl_c_in_flight_brings_the_vehicle_home_and_ends_with_130(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "2")
    running.until("uav1: armed")
    running.process.send_signal(signal.SIGINT)
    code, out, err = ended(running, 20)
    assert code == 130
    assert "uav1: is armed: its bridge is to order rtl (on_shutdown)" in out
    assert "uav1: its bridge left it: rtl" in out
    assert "error: stopped by ctrl-C" in err


def test_a_bridge_that_does_not_leave_is_killed_after_a_bound(start: Start, single_uav: Path) -> None:
    single_uav.write_text(single_uav.read_text() + "bring_home: 4s\n")
    running = start(single_uav, "--speed", "2", fault="stubborn")
    running.until("uav1: armed")
    running.process.send_signal(signal.SIGINT)
    code, out, _ = ended(running, 40)
    assert code == 130
    assert re.search(r"waiting for uav1 \(.* to be disarmed, 4 s left; ctrl-C again leaves", out)
    assert "bridged uav1: did not leave within 10 s and was killed" in out


@pytest.mark.parametrize("hurried", [False, True])
def test_a_mission_that_is_done_has_failed_if_its_vehicle_is_left_armed(
    start: Start, single_uav: Path, hurried: bool
) -> None:
    if not hurried:
        single_uav.write_text(single_uav.read_text() + "bring_home: 4s\n")
    running = start(single_uav, "--speed", "1", fault="done-aloft")
    running.until("argosy: done")
    for told in ("to be disarmed", "ctrl-C again leaves at once") if hurried else ():
        running.until(told)
        running.process.send_signal(signal.SIGINT)
    code, out, err = ended(running, 40)
    assert code == 1
    why = "left by ctrl-C" if hurried else "`bring_home` ran out after 4 s"
    assert re.search(rf"argosy: uav1 \(.* up\) left armed: {why}\n", out)
    assert re.fullmatch(rf"error: failed: uav1 \(.* up\) left armed: {why}\n", err)
    assert "single-uav: failed: uav1" in out


def test_of_two_runs_that_start_together_at_one_router_one_is_refused_and_does_not_join_the_other(
    start: Start, single_uav: Path
) -> None:
    runs = [start(single_uav, "--speed", "10") for _ in range(2)]
    codes = [ended(running, 90)[0] for running in runs]
    refused, flew = sorted(runs, key=lambda running: len(running.stdout))
    assert sorted(codes) == [0, 1]
    assert (refused.stdout, flew.stderr) == ("", "")
    assert "is in use: is another mission running?" in refused.stderr


def test_a_second_ctrl_c_hurries(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--speed", "2", fault="stubborn")
    running.until("uav1: armed")
    running.process.send_signal(signal.SIGINT)
    running.until("its bridge is to order rtl")
    running.process.send_signal(signal.SIGINT)
    code, out, _ = ended(running, 20)
    assert code == 130
    assert "argosy: hurrying" in out


def test_a_mission_that_is_not_done_in_time_fails_and_says_what_was_missing(start: Start, single_uav: Path) -> None:
    single_uav.write_text(single_uav.read_text().replace("timeout: 10min", "timeout: 30s"))
    code, _, err = ended(start(single_uav, "--speed", "10", fault="never-done"))
    assert code == 1
    assert "error: failed: not done within 30s of mission time (3 s here); expected uav: mission_done" in err


def test_a_mission_that_its_agent_gives_up_fails_at_once(start: Start, single_uav: Path) -> None:
    code, _, err = ended(start(single_uav, "--speed", "10", fault="gives-up"))
    assert code == 1
    assert 'error: failed: uav believes mission_failed("too windy")\n' in err


def test_a_mission_whose_agents_have_nothing_left_to_do_is_told_once(start: Start, single_uav: Path) -> None:
    single_uav.write_text(single_uav.read_text().replace("timeout: 10min", "timeout: 100s"))
    code, out, err = ended(start(single_uav, "--speed", "10", fault="aimless"))
    assert code == 1
    happened, _, last_words = out.partition("last warnings")
    told = "argosy: no agent has anything left to do; the mission ends at its timeout in "
    assert happened.count(told) == 1
    assert last_words.count(told) == 1
    assert "failed: not done within 100s" in err


@pytest.mark.parametrize(
    ("victim", "why"),
    [
        ("agentd serve", "uav has not shown its mind for 5 s"),
        ("commd serve", "the router at {endpoint} has not answered for 10 s"),
    ],
)
def test_a_daemon_that_freezes_ends_the_run_long_before_its_timeout(
    start: Start, single_uav: Path, endpoint: str, victim: str, why: str
) -> None:
    running = start(single_uav, "--speed", "1", fault="never-done")
    running.until("uav1: armed")
    running.family[victim].suspend()
    code, out, err = ended(running)
    assert code == 1, out
    assert f"error: failed: {why.format(endpoint=endpoint)}" in err


def test_a_port_that_is_in_use_is_told_with_the_option_that_names_another(
    start: Start, single_uav: Path, endpoint: str
) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", int(endpoint.rpartition(":")[2])))
        other.listen()
        code, out, err = ended(start(single_uav))
    assert code == 1
    assert f"error: {endpoint} is in use: is another mission running? Name another one, such as --router" in err
    assert "and give the robots other links" in err
    assert out == ""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--real", "uav1", "--speed", "5"), "--speed 5: uav1 is real, and real time runs at speed 1"),
        (("--real", "uav2"), "--real uav2: there is no such robot; the mission has uav1"),
        (("--speed", "0"), "argument --speed: invalid speed (0 < X <= 100) value: '0'"),
        (
            ("--router", "nonsense"),
            "argument --router: Expected an endpoint such as `tcp/127.0.0.1:7447`, got `nonsense`",
        ),
        (("--report", "/proc/nowhere"), "--report /proc/nowhere: No such file or directory"),
    ],
)
def test_options_that_cannot_be_are_refused_before_anything_starts(
    start: Start, single_uav: Path, arguments: tuple[str, ...], message: str
) -> None:
    code, out, err = ended(start(single_uav, *arguments))
    assert code == 2
    assert message in err
    assert out == ""


def test_a_mission_that_does_not_check_does_not_start(start: Start, single_uav: Path) -> None:
    single_uav.write_text(single_uav.read_text().replace("timeout:", "time_out:"))
    code, out, err = ended(start(single_uav))
    assert code == 2
    assert "unknown field `time_out`, did you mean `timeout`?" in err
    assert out == ""


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


def test_a_real_robot_gets_no_simulator_and_real_time(start: Start, single_uav: Path) -> None:
    running = start(single_uav, "--real", "uav", "--yes")  # named by its agent
    running.until("agentd uav: up")
    assert "simulator" not in running.stdout
    assert not any("simulate" in line or "simulator" in line for line in running.family)


@pytest.mark.parametrize("named", [True, False])
def test_without_a_terminal_a_real_robot_is_only_flown_with_yes(
    single_uav: Path, tmp_path: Path, endpoint: str, named: bool
) -> None:
    if not named:  # real in any case
        lines = single_uav.read_text().splitlines(keepends=True)
        single_uav.write_text("".join(line for line in lines if "simulate:" not in line and "speed:" not in line))
    command = [sys.executable, "-m", "argosy", "run", str(single_uav), "--router", endpoint]
    command += ["--real", "uav1"] if named else []
    done = subprocess.run(command, input="y\n", capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr == (
        "error: this would arm and fly the real vehicle uav1; without a terminal to ask at, confirm by --yes\n"
    )


def test_a_serial_link_is_flown_with_real_and_refused_without(start: Start, single_uav: Path) -> None:
    lines = [
        "    link: serial:/dev/nowhere:57600\n" if line.startswith("    link:") else line
        for line in single_uav.read_text().splitlines(keepends=True)
    ]
    single_uav.write_text("".join(lines))
    code, out, err = ended(start(single_uav))
    assert (code, out) == (2, "")
    told = "uav1 on serial:/dev/nowhere:57600: a serial line cannot be simulated; fly the real one with --real uav1"
    assert err == f"error: {told}\n"
    running = start(single_uav, "--real", "uav1", "--yes")
    running.until("bridged uav1: started")


def test_robots_of_one_link_are_all_real_or_all_simulated(start: Start, three_uavs: Path) -> None:
    code, out, err = ended(start(three_uavs, "--real", "uav2", "--yes"))
    assert (code, out) == (2, "")
    link = re.search(r"udpin:\S+", three_uavs.read_text())
    assert link is not None
    told = f"uav2 is real, and uav1, uav3 on the same link {link[0]} would be simulated"
    assert err == f"error: {told}: fly all of them with --real uav1,uav2,uav3\n"


@pytest.mark.parametrize("kind", ["udpin", "tcpin", "udpout", "tcp"])
def test_a_link_that_is_taken_is_told_before_anything_starts(start: Start, single_uav: Path, kind: str) -> None:
    single_uav.write_text(single_uav.read_text().replace("udpin:", f"{kind}:"))
    found = re.search(rf"{kind}:127.0.0.1:(\d+)", single_uav.read_text())
    assert found is not None
    with socket.socket(type=socket.SOCK_DGRAM if kind.startswith("udp") else socket.SOCK_STREAM) as other:
        other.bind(("127.0.0.1", int(found[1])))
        if kind.startswith("tcp"):
            other.listen()
        code, out, err = ended(start(single_uav))
    line = 1 + single_uav.read_text()[: found.start()].count("\n")
    bound = {"udpout": "udpin", "tcp": "tcpin"}.get(kind, kind)
    assert (code, out) == (1, "")
    assert err == (
        f"error: {single_uav}:{line}: {bound}:127.0.0.1:{found[1]} is in use: is another mission running? "
        "Give uav1 another link\n"
    )


def test_a_startup_that_hangs_is_bounded_and_says_what_it_waits_for(
    start: Start, single_uav: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STARTUP_PATIENCE", "5")
    code, _, err = ended(start(single_uav, "--speed", "10", fault="agent-mute"))
    assert code == 1
    assert "error: failed at the start: timed out after 5 s: waited for agentd uav" in err


def test_ctrl_c_while_it_starts_leaves_nothing_behind(start: Start, single_uav: Path) -> None:
    running = start(single_uav)
    running.until("commd: started")
    running.process.send_signal(signal.SIGINT)
    code, _, err = ended(running, 20)
    assert code == 130
    assert "Traceback" not in err


def test_a_terminal_that_goes_away_ends_the_run_and_leaves_nothing_behind(single_uav: Path, endpoint: str) -> None:
    with Terminal([str(DOUBLES), "run", str(single_uav), "--router", endpoint, "--speed", "2"]) as terminal:
        terminal.until(lambda _: b"agentd uav" in terminal.output and b"armed" in terminal.output, "the flight")
        family = psutil.Process(terminal.pid).children(recursive=True)
        assert terminal.hang_up() == 128 + signal.SIGHUP
    assert len(family) == 4
    assert psutil.wait_procs(family, timeout=5)[1] == []


@pytest.mark.parametrize("kind", ["dumb", ""])
def test_a_terminal_that_cannot_be_steered_gets_plain_lines(single_uav: Path, endpoint: str, kind: str) -> None:
    run = [str(DOUBLES), "run", str(single_uav), "--router", endpoint, "--speed", "2"]
    with Terminal(run, TERM=kind) as terminal:
        terminal.shows("commd: up")
        terminal.hang_up()
    assert b"\x1b" not in terminal.output


@pytest.mark.parametrize("missing", ["rich", "psutil"])
def test_a_missing_extra_is_one_line_that_says_what_to_install(single_uav: Path, endpoint: str, missing: str) -> None:
    code = f"import sys; sys.modules['{missing}'] = None; from argosy.__main__ import main; sys.exit(main())"
    terminal, inside = pty.openpty()  # the live view needs one
    command = [sys.executable, "-c", code, "run", str(single_uav), "--router", endpoint]
    environment = {**os.environ, "TERM": "xterm-256color"}
    done = subprocess.run(
        command, stdout=inside, stderr=subprocess.PIPE, env=environment, text=True, timeout=60, check=False
    )
    os.close(inside)
    os.close(terminal)
    assert done.returncode == 2
    assert done.stderr == f"error: argosy needs {missing}: {install_command('operator')}\n"


def test_the_run_says_on_the_bus_how_far_it_has_come_and_how_it_ended(
    start: Start, single_uav: Path, tmp_path: Path, endpoint: str
) -> None:
    running = start(single_uav, "--speed", "10", "--report", str(tmp_path / "report"))
    running.until("commd: up")
    told: list[RunState] = []

    async def listen() -> None:
        async with open_bus(endpoint, fleet="single-uav", name="ears", daemon="argosy", stamp=time.time_ns) as bus:
            bus.subscribe(keys.run("single-uav", "*"), RunState, lambda key, state: told.append(state))
            await until(lambda: bool(told) and told[-1].phase in ("done", "failed"), "the run ends", 240)

    asyncio.run(listen())
    assert ended(running)[0] == 0
    assert list(dict.fromkeys(state.phase for state in told)) in (
        ["starting", "flying", "done"],
        ["flying", "done"],
    )
    last = told[-1]
    assert (last.why, last.report, last.recording) == (
        "",
        str(tmp_path / "report"),
        str(tmp_path / "report" / "recording.mcap"),
    )
    assert last.mission_time > 20
