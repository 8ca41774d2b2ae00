"""What else a page asks: why an agent did something, and which of several fleets is meant."""

from __future__ import annotations

import msgspec

from commd.bus import Bus, BusClosed

NOBODY = "the router is not reached"


class WhyWish(msgspec.Struct, forbid_unknown_fields=True):
    """What a page wants to know."""

    agent: str
    about: str = ""
    """A goal, belief or action; empty: what happened last."""


class FleetWish(msgspec.Struct, forbid_unknown_fields=True):
    """Which of several fleets a page wants to see."""

    fleet: str


class Explained(msgspec.Struct, omit_defaults=True):
    """The answer: an explanation (argosy/why), or the reason why there is none."""

    explanation: object = None
    error: str = ""


async def explained(bus: Bus | None, fleet: str, wish: WhyWish) -> Explained:
    """Ask an agent why."""
    if bus is None or not fleet:
        return Explained(error=NOBODY)
    try:
        from argosy.why import explain
    except ImportError:
        return Explained(error="`argosy why` is not there yet")
    try:
        return Explained(await explain(bus, fleet, wish.agent, wish.about))
    except BusClosed as closed:
        return Explained(error=str(closed))
