"""When a daemon looks for garbage in circles.

Python frees almost everything by itself. What it looks for besides, in all that there is, is rare in a daemon, and
while it looks no mind reasons and no percept is taken: a look at the minds of a thousand agents takes a second.
"""

from __future__ import annotations

import asyncio
import gc
from typing import Final

SETTLED: Final = 3.0
"""Wall seconds after the start by which everything is loaded."""
YOUNG: Final = 3_000
"""Objects made, and not freed, from one look at the newest to the next; Python's own 700 are fewer than mailboxes
hold."""
YOUNG_EACH: Final = 1_000
"""The same for each mind of the daemon: its last decisions, and its mail between two commits, come and go: of fewer
objects nearly all are in use at each look."""


def look_seldom(minds: int = 0) -> None:
    """Look seldom from now on, and after `SETTLED` for the last time at what is there then; on the event loop.

    `minds` is the number of minds in the daemon, 0 or more.
    """
    gc.set_threshold(YOUNG + YOUNG_EACH * minds, *gc.get_threshold()[1:])
    asyncio.get_running_loop().call_later(SETTLED, settle)


def settle() -> None:
    """Exempt what is loaded from further looks."""
    gc.collect()
    gc.freeze()
