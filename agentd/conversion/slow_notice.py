"""A word to the user when something takes longer than one waits without wondering."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from time import process_time

PATIENCE = 1.0
"""Seconds of the processor's time without a word: a machine that is busy with other things makes no program large."""
_NAMED = 3
"""Files that the word names at most."""


def loading(files: Iterable[str]) -> str:
    """What is told while programs are read and begun with."""
    names = list(files)
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return f"still loading {', '.join(names[:_NAMED])}{more} ..."


@contextmanager
def told_if_long(text: str, tell: Callable[[str], object] | None = None, after: float = PATIENCE) -> Iterator[None]:
    """Tell a text once if the block takes more than `after` seconds of processor time; without `tell`, on stderr."""
    done = Event()
    begun = process_time()

    def watch() -> None:
        while not done.wait(after):
            if process_time() - begun >= after:
                (tell or _on_stderr)(text)
                return

    watching = Thread(target=watch, name="progress", daemon=True)
    watching.start()
    try:
        yield
    finally:
        done.set()
        watching.join(PATIENCE)  # what it tells stands before what comes next


def _on_stderr(text: str) -> None:
    with suppress(OSError, ValueError):  # closed: nobody waits
        print(text, file=sys.stderr, flush=True)
