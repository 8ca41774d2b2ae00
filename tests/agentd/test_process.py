"""Commands as processes: signals, an output that cannot be written, and the notice that loading is slow."""

import signal
import subprocess
import sys
from pathlib import Path
from time import process_time, sleep

import pytest

from agentd.process import loading_notice
from tests.agentd.conftest import Command, Ran, agentd

AGENTD = [sys.executable, "-m", "agentd"]
FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="the system has no /dev/full")

ENVIRONMENT = """
import sys
from agentd import Environment

class Motors(Environment):
    def init(self, arguments):
        print("motors on", flush=True)

    def stop(self):
        print("motors off", flush=True)

class Quitter(Environment):
    def execute(self, agent, action):
        sys.exit(7)

class Hasty(Environment):
    def init(self, arguments):
        sys.exit(7)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "motors.py").write_text(ENVIRONMENT)
    (tmp_path / "fast.asl").write_text('!s. +!s <- .print("done"); .stopMAS.')
    (tmp_path / "waits.asl").write_text('!s. +!s <- .print("waits"); .wait("+never").')
    (tmp_path / "acts.asl").write_text("!s. +!s <- act. -!s[error_msg(M)] <- .print(M); .stopMAS.")
    return tmp_path


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_lets_the_environment_stop_and_shows_in_the_exit_code(folder: Path, number: signal.Signals) -> None:
    command = [*AGENTD, "run", "--env", "motors:Motors", "waits.asl"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "motors on\n"
        assert process.stdout.readline() == "[waits] waits\n"
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert out == "motors off\n"
    assert process.returncode == 128 + number
    assert "Traceback" not in err
    assert (f"ended by {number.name}" in err) == (number is not signal.SIGINT)


@needs_full
@pytest.mark.parametrize("command", [["run", "fast.asl"], ["check", "--json", "fast.asl"], ["test", "t.asl"]])
def test_output_that_cannot_be_written_is_reported_in_one_line(folder: Path, command: list[str]) -> None:
    (folder / "t.asl").write_text("@t[test] +!t <- !force_pass.")
    with FULL.open("w") as full:
        done = subprocess.run(
            [*AGENTD, *command], cwd=folder, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False
        )
    assert done.stderr == "agentd: error: cannot write the output: No space left on device\n"
    assert done.returncode == 1


@pytest.mark.parametrize("command", ["run fast.asl", "check --json fast.asl"])
def test_a_closed_standard_output_is_reported(folder: Path, command: str) -> None:
    shell = f'exec "{sys.executable}" -m agentd {command} >&-'
    done = subprocess.run(["sh", "-c", shell], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    assert done.stderr == "agentd: error: standard output is closed; send it to /dev/null if nobody wants it\n"
    assert done.returncode == 2


@pytest.mark.parametrize("value", ["inf", "nan", "-1", "0", "1e300", "soon"])
def test_a_timeout_that_is_none_is_refused(folder: Path, value: str) -> None:
    done = agentd("run", f"--timeout={value}", "fast.asl", cwd=folder)
    assert done.returncode == 2
    assert f"argument --timeout: `{value}`" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_wait_beyond_all_bounds_is_only_a_long_wait(folder: Path) -> None:
    (folder / "long.asl").write_text(
        '!s. !e. +!s <- .wait("+never", 1e300). +!e <- .wait(200); .print("here"); .stopMAS.'
    )
    done = agentd("run", "long.asl", cwd=folder)
    assert (done.stdout, done.stderr, done.returncode) == ("[long] here\n", "", 0)


def test_an_environment_that_would_end_the_process_is_reported_with_its_place(folder: Path) -> None:
    done = agentd("run", "--env", "motors:Quitter", "acts.asl", cwd=folder)
    assert "execute went wrong in act/0: SystemExit: 7 (" in done.stdout
    assert "motors.py:14, in execute)" in done.stderr
    assert done.returncode == 0
    done = agentd("run", "--env", "motors:Hasty", "acts.asl", cwd=folder)
    assert "the environment's init failed: SystemExit: 7 (" in done.stderr
    assert done.returncode == 2


def test_an_internal_action_that_would_end_the_process_is_reported_with_its_place(folder: Path) -> None:
    source = (folder / "motors.py").read_text()
    action = """
from agentd import internal_action

@internal_action("mine.quit", 0)
def quit_(mind, trail):
    sys.exit(7)
"""
    (folder / "motors.py").write_text(source + action)
    (folder / "quits.asl").write_text("!s. +!s <- mine.quit.")
    done = agentd("run", "--env", "motors:Motors", "quits.asl", cwd=folder)
    assert done.stdout == "motors on\nmotors off\n"
    assert "SystemExit: 7 (" in done.stderr
    assert "in quit_)" in done.stderr
    assert done.returncode == 1


def test_tests_that_are_broken_off_leave_their_report(tmp_path: Path) -> None:
    (tmp_path / "t.asl").write_text(
        "@a[test] +!a <- !assert_true(true).\n@b[test] +!b <- !loop(0).\n+!loop(N) <- !loop(N+1).\n"
    )
    command = [*AGENTD, "test", "t.asl", "--junit", "out.xml"]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline().startswith("ok")  # the first is over, the second runs for ever
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 143
    assert "1 passed" in out
    assert '<testcase name="a"' in (tmp_path / "out.xml").read_text()
    if "2 tests" in out:  # the signal may come before the second one begins
        assert "ERROR   t.asl:2 b: the run was interrupted while this test ran" in out


def test_an_agent_without_a_name_is_refused(command: Command) -> None:
    assert command({}, "run", "=x.asl") == Ran(
        2, "", "=x.asl: error: the agent has no name; NAME=FILE.asl is expected\n"
    )


def test_loading_that_takes_long_is_noted_once_on_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with loading_notice(["a.asl", "b.asl", "c.asl", "d.asl"], after=0.02):
        end = process_time() + 0.2
        while process_time() < end:
            pass
    assert capsys.readouterr().err == "still loading a.asl, b.asl, c.asl and 1 more ...\n"


def test_loading_that_only_waits_for_the_processor_is_not_noted(capsys: pytest.CaptureFixture[str]) -> None:
    with loading_notice(["never.asl"], after=0.1):
        sleep(0.15)
    assert capsys.readouterr().err == ""
