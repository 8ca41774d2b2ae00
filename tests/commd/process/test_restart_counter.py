"""How often a daemon was started again, from a note on disk."""

import subprocess
import sys
from pathlib import Path

import pytest

from commd.process.restart_counter import MUTE, RestartCounter
from tests.support.processes import ROOT

DAEMON = """\
import os, sys
from pathlib import Path
from commd.process.restart_counter import note_start
from commd.process.process import run_daemon

async def main(stop):
    print(*note_start(Path(sys.argv[1]), "agentd", "a"))
    if sys.argv[2] == "dies":
        sys.stdout.flush()
        os.kill(os.getpid(), 9)
    if sys.argv[2] == "fails":
        raise ValueError("no such thing")
    return 0

raise SystemExit(run_daemon("agentd", main))
"""


def test_killed_and_failed_lives_are_counted_and_those_that_ended_as_told_are_not(tmp_path: Path) -> None:
    def live(how: str) -> str:
        command = [sys.executable, "-c", DAEMON, str(tmp_path / "fleet"), how]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=ROOT).stdout.strip()

    assert live("well") == "0"
    assert live("dies") == "0"
    assert live("fails") == f"1 {MUTE}"
    assert live("well") == "2 defect in argosy: ValueError: no such thing"
    assert live("well") == "2"


def test_a_machine_that_started_anew_begins_at_nought(tmp_path: Path) -> None:
    note = tmp_path / "pi1.commd.restarts"
    assert [RestartCounter(note, "one").restarts for _ in range(3)] == [0, 1, 2]
    rebooted = RestartCounter(note, "two")
    assert (rebooted.restarts, rebooted.before) == (0, "")
    assert RestartCounter(note, "two").restarts == 1


def test_a_note_that_cannot_be_read_begins_anew_and_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    note = tmp_path / "pi1.commd.restarts"
    note.write_text('{"restarts": "many"')
    assert RestartCounter(note, "one").restarts == 0
    assert "restarts are counted from 0" in caplog.text
    assert RestartCounter(note, "one").restarts == 1


@pytest.mark.parametrize("left", [b"", b"\0" * 40], ids=["nothing", "noughts"])
def test_a_note_lost_in_a_power_failure_is_none(tmp_path: Path, caplog: pytest.LogCaptureFixture, left: bytes) -> None:
    note = tmp_path / "pi1.commd.restarts"
    note.write_bytes(left)
    assert RestartCounter(note, "two").restarts == 0
    assert not caplog.text


def test_where_nothing_can_be_written_restarts_are_not_known(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("")
    life = RestartCounter(tmp_path / "file" / "pi1.commd.restarts", "one")
    assert life.restarts is None
    assert "restarts are not counted" in caplog.text
    life.end("whatever")


def test_the_unit_may_tell_which_life_of_the_machine_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    note = tmp_path / "pi1.commd.restarts"
    lives = []
    for boot in ("one", "one", "two", "two"):
        monkeypatch.setenv("ARGOSY_BOOT", boot)
        lives.append(RestartCounter(note).restarts)
    assert lives == [0, 1, 0, 1]
