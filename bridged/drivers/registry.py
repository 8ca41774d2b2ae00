"""Importing what installed packages declare: with a bound, for a package may do anything when it is imported."""

from __future__ import annotations

import logging
import sys
import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # megabytes, for those that have no extension
    from importlib.metadata import EntryPoint

PATIENCE = 20.0
"""Wall seconds that an import may take; the event loop, and with it every signal, waits for it."""
log = logging.getLogger("drivers")


class SlowImport(ImportError):
    """An import has not ended within `PATIENCE`."""


def load(entry: EntryPoint) -> Any:
    """Import what an entry point names, in a thread. Raises SlowImport, and whatever the import does."""
    if entry.module not in sys.modules:
        log.info("importing %s, which `%s` names", entry.module, entry.name)
    result: list[Any] = []
    failure: list[BaseException] = []

    def work() -> None:
        try:
            result.append(entry.load())
        except BaseException as error:
            failure.append(error)

    thread = threading.Thread(target=work, name=f"import {entry.module}", daemon=True)
    thread.start()
    thread.join(PATIENCE)
    if failure:
        raise failure[0]
    if not result:
        raise SlowImport(f"it has not ended within {PATIENCE:g} s")
    return result[0]
