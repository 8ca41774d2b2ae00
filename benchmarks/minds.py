"""Asking a mind whether its mission is done."""

from __future__ import annotations

from typing import Final

from commd.bus.bus import Bus
from commd.bus.errors import QueryFailed
from schemas.wire import keys
from schemas.wire.mind_records import MindView

ANSWER: Final = 2.0
"""Wall seconds for an answer of a mind."""


async def done(bus: Bus, agent: str) -> bool:
    """Return whether the `done` formulas of an agent hold; a look that shows next to nothing else, to cost little."""
    key = f"{keys.mind(bus.fleet, agent)}?last=0;beliefs=0;about=nothing"
    try:
        view = await bus.ask_one(key, None, MindView, ANSWER)
    except QueryFailed:
        return False
    return bool(view.done) and all(view.done.values())
