"""The timeline as rows, made once for each entry: thousands are kept, and few are new."""

from __future__ import annotations

from rich.text import Text

from argosy.fleet_model import Entry, TeamModel
from argosy.run.screen import STYLES
from argosy.watch.row_text import Row

MOST = 2_000
"""Rows that are shown."""


class TimelineRows:
    """The rows of a timeline; of one agent and its robot, if they are named."""

    def __init__(self, *names: str) -> None:
        self._names = frozenset(names)
        self._number = 0
        self._model: TeamModel | None = None
        self.rows: list[Row] = []
        self._entries: list[tuple[float, int, Row]] = []

    def update(self, model: TeamModel) -> list[Row]:
        """Return the rows for what the model has now."""
        if model is not self._model:  # paused, or going on again
            self._model, self._number, self._entries, self.rows = model, 0, [], []
        new = [
            (one.at, one.number, _row(model, one)) for one in model.timeline.since(self._number) if self._concerns(one)
        ]
        self._number = model.timeline.number
        if new:  # agents tell their deeds a moment later than bridges: by time, not as they were told
            self._entries = sorted([*self._entries, *new], key=lambda entry: entry[:2])[-MOST:]
            self.rows = [row for _, _, row in self._entries]
        return self.rows

    def _concerns(self, entry: Entry) -> bool:
        return not self._names or entry.who in self._names


def _row(model: TeamModel, entry: Entry) -> Row:
    style = STYLES[entry.level] if entry.what not in ("sent", "received") else "magenta"
    seconds = model.clock.seconds(entry.at)
    time = entry.clock if seconds is None else f"{seconds:8.1f}"
    text = Text.assemble((f"{time} ", "dim"), (f"{entry.who}  ", "bold"), (entry.text, style))
    return Row(text, indent=10, found_by=entry.what)
