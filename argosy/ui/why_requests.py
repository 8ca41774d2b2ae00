"""What else a page asks: why an agent did something, and which of several fleets is meant."""

from __future__ import annotations

import msgspec

from argosy.cli.operator_bus import Unanswered
from argosy.ui.control_requests import misnamed
from argosy.why import Explanation, explain
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed
from schemas.files.findings import Findings

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

    explanation: Explanation | None = None
    error: str = ""


async def explained(bus: Bus | None, fleet: str, wish: WhyWish) -> Explained:
    """Ask an agent why."""
    if wrong := misnamed((wish.agent,), "an agent"):
        return Explained(error=wrong)
    if bus is None or not fleet:
        return Explained(error=NOBODY)
    try:
        return Explained(await explain(bus, fleet, wish.agent, wish.about))
    except (BusClosed, Unanswered) as error:
        return Explained(error=str(error))
    except Findings as findings:
        return Explained(error="; ".join(one.message for one in findings.findings))
