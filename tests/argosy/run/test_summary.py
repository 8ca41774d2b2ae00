"""The report of a run."""

from pathlib import Path

import pytest

from argosy.run.summary import write_report
from tests.argosy.recording.test_disks import files_no_larger_than


def test_without_a_recording_the_summary_is_written_and_an_older_figure_is_gone(tmp_path: Path) -> None:
    (tmp_path / "track.svg").write_text("of another run")
    assert write_report(tmp_path, None, "single-uav: done\n") == "there is no recording"
    assert [path.name for path in tmp_path.iterdir()] == ["summary.txt"]


def test_a_summary_that_has_no_room_leaves_the_one_before(tmp_path: Path) -> None:
    (tmp_path / "summary.txt").write_text("before")
    with files_no_larger_than(10), pytest.raises(OSError, match="File too large"):
        write_report(tmp_path, None, "single-uav: done\n")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("summary.txt", "before")]


def test_why_a_recording_gives_no_figure_is_told(tmp_path: Path) -> None:
    (tmp_path / "recording.mcap").write_text("no recording")
    why = write_report(tmp_path, tmp_path / "recording.mcap", "single-uav: done\n")
    assert why.startswith(f"{tmp_path}/recording.mcap: ")
    assert not (tmp_path / "track.svg").exists()
