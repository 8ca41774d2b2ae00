"""The recording of a run: beside the daemons, whole from the first word on, and no flight ends with it."""

from pathlib import Path

import pytest

from argosy.cli.errors import BadInput
from argosy.cli.extras import install_command
from argosy.recording import run_recorder
from argosy.recording.reader import Recording
from argosy.recording.run_recorder import RunRecording, recording_of, what_became_of_it
from schemas.wire.log_lines import LogLine, RecordingEnded
from tests.argosy.conftest import Start


def test_a_recorder_that_dies_ends_no_flight_and_is_told_of(start: Start, single_uav: Path, tmp_path: Path) -> None:
    path = tmp_path / "flight.mcap"
    run = start(single_uav, "--speed", "10", "--record", str(path))
    run.until("taking off")
    recorder = next(process for line, process in run.family.items() if " argosy record " in line)
    recorder.kill()
    assert run.wait() == 0
    told = "recorder single-uav: was killed by SIGKILL; the run goes on and is no longer recorded"
    assert told in run.stdout
    assert "  recording  cut off: the recorder was killed by SIGKILL" in run.stdout
    assert "done" in run.stdout
    assert Recording(path).missing
    assert run.left_running() == []


def test_without_the_extra_a_report_is_written_all_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert recording_of(None, None) == ""
    assert recording_of(None, tmp_path) == RunRecording(tmp_path / "recording.mcap", asked_for=False)
    monkeypatch.setattr(run_recorder, "find_spec", lambda name: None)
    assert recording_of(None, tmp_path) == f"no recording: it needs `{install_command('record')}`"
    with pytest.raises(BadInput, match=r"a.mcap: it needs `.* -m pip install -e '.*\[record\]'`"):
        recording_of(tmp_path / "a.mcap", None)


def test_what_became_of_it_is_what_the_recorder_said_last() -> None:
    ended = RecordingEnded(text="a.mcap: 5 messages in 2.0 s, 3.0 kB")
    said = [LogLine(text="recording a.mcap"), LogLine(text="ended", event=ended), LogLine(text="warning: ...")]
    assert what_became_of_it(said, "left") == "a.mcap: 5 messages in 2.0 s, 3.0 kB"
    assert what_became_of_it(said[:1], "was killed by SIGKILL") == "cut off: the recorder was killed by SIGKILL"
