"""What a recorder tells: one line while it records, some at its end."""

from __future__ import annotations

import asyncio
import sys
from typing import Self

from argosy.recording.record.filter import NOTES
from argosy.recording.record.recorder import Recorder
from schemas.humanize import count, size

REFRESH = 1.0
"""Wall seconds between two looks at the recorder."""


class StatusLine:
    """The line that is written over and over on a terminal; nothing where there is none."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder, self._shown = recorder, False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)

    async def show(self) -> None:
        """Show it until cancelled."""
        if not sys.stderr.isatty():
            return
        before, recorder = 0, self._recorder
        while True:
            messages = recorder.messages
            told = f"{recorder.seconds:.0f} s  {(messages - before) / REFRESH:.0f} messages/s"
            print(
                f"\r\x1b[K{told}  {size(recorder.size)}  {recorder.dropped} dropped",
                end="",
                file=sys.stderr,
                flush=True,
            )
            before, self._shown = messages, True
            await asyncio.sleep(REFRESH)


def content(recorder: Recorder) -> str:
    """Return how much was recorded, and where it is."""
    many = f"{count(recorder.messages, 'message')} in {recorder.seconds:.1f} s"
    files = str(recorder.path) if len(recorder.files) == 1 else f"{recorder.path} and {len(recorder.files) - 1} more"
    return f"{files}: {many}, {size(recorder.size)}"


def warnings(recorder: Recorder) -> list[str]:
    """Return what is missing in a recording or was not understood."""
    lines = []
    if recorder.dropped:
        lines.append(f"warning: {recorder.dropped} messages did not fit and are missing")
    if recorder.unread:
        lines.append(f"note: {recorder.unread} messages are neither JSON nor MessagePack and are kept as bytes")
    if recorder.wild:
        lines.append(f"warning: {recorder.wild} messages were put on many keys at once (`*`): they stand under {NOTES}")
    return lines + [f"warning: {gap}" for gap in [*recorder.minds.gaps(), *recorder.minds.cut_short()]]
