"""The report of a run: its summary, and the figure of its recording, beside the log."""

from __future__ import annotations

import subprocess
from pathlib import Path

from argosy.processes.process_table import python_command

FIGURE = "track.svg"
PLOT_PATIENCE = 120.0
"""Wall seconds that the figure may take."""


def write_report(folder: Path, recording: Path | None, text: str) -> str:
    """Write `summary.txt`, and `track.svg` as `argosy plot` draws it. Returns why there is none. Raises OSError."""
    (folder / "summary.txt").write_text(text, encoding="utf-8")
    (folder / FIGURE).unlink(missing_ok=True)
    if recording is None or not recording.exists():
        return "there is no recording"
    command = [*python_command(), "argosy", "plot", str(recording), "--out", str(folder / FIGURE)]
    try:
        plotted = subprocess.run(command, capture_output=True, text=True, timeout=PLOT_PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        return f"it was not drawn within {PLOT_PATIENCE:g} s"
    return plotted.stderr.strip().removeprefix("error: ") if plotted.returncode else ""
