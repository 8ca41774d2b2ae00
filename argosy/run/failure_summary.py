"""Why a run was not done, for the summary: the view that showed it is gone by then."""

from __future__ import annotations

from argosy.run.end_conditions import Ending
from argosy.run.run_status import Status

MOST = 10
"""Entries of the journal that are told again."""
MOST_LINES = 5
"""Last lines of each dead process that are told."""


def last_words(status: Status, ending: Ending) -> list[str]:
    """Return the last warnings and errors of a run and the last lines of dead processes, nothing twice."""
    told: dict[tuple[str, str], str] = {}
    for entry in status.journal.entries:
        if entry.level in ("warning", "error") and entry.text not in ending.text:
            told.pop((entry.who, entry.text), None)  # said again: it stands where it was said last
            told[entry.who, entry.text] = str(entry)
    lines = ["  last words", *(f"  {text}" for text in list(told.values())[-MOST:])] if told else []
    for child in status.children:
        if not child.dead:
            continue
        texts = [f"[{line.agent}] {line.text}" if line.agent else line.text for line in child.lines]
        new = [text for text in texts if text not in ending.text and (child.name, text) not in told][-MOST_LINES:]
        lines += [f"  last lines of {child.name}", *(f"    {text}" for text in new)] if new else []
    return [*lines, ""] if lines else []
