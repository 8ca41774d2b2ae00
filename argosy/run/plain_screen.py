"""The run as plain lines: for pipes, logs and dumb terminals."""

from __future__ import annotations

from typing import TextIO

from argosy.cli.journal import Entry


class PlainView:
    """Writes each entry of the journal as one line."""

    def __init__(self, out: TextIO) -> None:
        self._out = out

    def __enter__(self) -> PlainView:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def show(self, entry: Entry) -> None:
        """Write one line."""
        try:
            print(entry, file=self._out, flush=True)
        except OSError:  # the reader is gone; vehicles still have to be brought home
            self.show = lambda entry: None  # type: ignore[method-assign]

    def refresh(self) -> None:
        """Do nothing: lines are written as they come."""
