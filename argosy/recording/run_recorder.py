"""The recording of a run: `argosy record` as a process beside the daemons; its death does not end the flight."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from argosy.cli.errors import BadInput
from argosy.cli.extras import install_command
from schemas.wire.log_lines import LogLine, RecordingEnded

IN_A_REPORT = "recording.mcap"
"""Name of the recording in the folder of a report."""
MISSING = f"no recording: it needs `{install_command('record')}`"


@dataclass(frozen=True)
class RunRecording:
    """Where a run is recorded."""

    path: Path
    asked_for: bool
    """Whether the run needs it (`--record`). A report does without it."""


def recording_of(record: Path | None, report: Path | None) -> RunRecording | str:
    """Return where a run is recorded, or why it is not; empty = not requested. Raises BadInput."""
    if record is None and report is None:
        return ""
    if find_spec("mcap") is None:
        if record is not None:
            raise BadInput(f"--record {record}: it needs `{install_command('record')}`")
        return MISSING
    if record is not None:
        if record.exists():
            raise BadInput(f"--record {record}: the file exists: name another one")
        if not record.absolute().parent.is_dir():
            raise BadInput(f"--record {record}: folder {record.parent} does not exist")
        try:
            record.open("xb").close()
            record.unlink()
        except OSError as error:
            raise BadInput(f"--record {record}: {error.strerror}") from None
        return RunRecording(record, True)
    assert report is not None
    return RunRecording(report / IN_A_REPORT, False)


def what_became_of_it(lines: Iterable[LogLine], how: str) -> str:
    """Return what a recorder has recorded, as text. `how` it ended is part of it if its file is incomplete."""
    ended = next((line.event for line in lines if isinstance(line.event, RecordingEnded)), None)
    return f"cut off: the recorder {how}" if ended is None else ended.text


def record_command(recording: RunRecording, mission: str, router: str, speed: float) -> list[str]:
    """Return the recorder's module and its arguments; `speed` is in mission seconds per wall second."""
    to = ["--output", str(recording.path)]
    if not recording.asked_for:  # a report overwrites the files of an earlier one
        to.append("--force")
    return ["argosy", "record", "--mission", mission, "--router", router, "--speed", f"{speed:g}", *to]
