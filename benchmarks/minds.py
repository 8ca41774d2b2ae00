"""Asking a mind whether its mission is done."""

from __future__ import annotations

from contextlib import aclosing
from typing import Final

from commd.bus import Bus
from schemas import keys
from schemas.minds import MindView

ANSWER: Final = 2.0
"""Wall seconds for an answer of a mind."""


async def done(bus: Bus, agent: str) -> bool:
    """Return whether the `done` formulas of an agent hold; a look that shows next to nothing else, to cost little."""
    key = f"{keys.mind(bus.fleet, agent)}?last=0;beliefs=0;about=nothing"
    async with aclosing(bus.query(key, None, MindView, ANSWER)) as replies:
        async for reply in replies:
            if reply.record is not None:
                return bool(reply.record.done) and all(reply.record.done.values())
    return False
