"""Requests of the page's buttons: orders to robots above every agent, and orders to minds; the outcome as reported.

As in `argosy stop` every robot of the mission is ordered, seen or not, and whoever did not confirm is named.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from typing import Literal

import msgspec
from msgspec.structs import replace

from argosy.cli.operator_bus import Unanswered, bridges
from argosy.fleet_model.link import FleetLink
from argosy.fleet_model.mission_clock import steady_clock
from argosy.stop.command import UNANSWERED, order_robot
from argosy.ui.view_structs import OrderedView
from argosy.why import Explanation, explain
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError, QueryTimeout
from schemas.files.findings import Findings
from schemas.wire import keys
from schemas.wire.keys import check_name
from schemas.wire.mind_records import MindOrder
from schemas.wire.records import OperatorOrder, Outcome

WAITING = ("waiting", "")
CUT = ("NOT confirmed", "interrupted: NOT known whether it was carried out")
NOBODY = "the router is not reached: the order was not sent"
ROBOTS = 200
"""Robots of one order."""
KEPT = 20
"""Orders that pages show."""
CONTROL_PATIENCE = 5.0
"""Wall seconds that an agent has to answer."""
LONGEST = 4_000
"""Characters of a goal or belief."""
LATE = 5.0
"""Wall seconds after which an order is refused: the operator decided on an older state."""
UNREACHED = "the router is not reached"


class StopWish(msgspec.Struct, forbid_unknown_fields=True):
    """An order to robots."""

    order: OperatorOrder
    at: float
    """When it was given, by our clock as the page knows it."""
    robots: list[str] | None = None
    """None: all."""


class ControlWish(msgspec.Struct, forbid_unknown_fields=True):
    """An order to a mind."""

    agent: str
    do: Literal["pause", "step", "resume", "goal", "belief"]
    at: float
    text: str = ""


class WhyWish(msgspec.Struct, forbid_unknown_fields=True):
    """A question why an agent did something."""

    agent: str
    about: str = ""
    """A goal, belief or action; empty: what happened last."""


class FleetWish(msgspec.Struct, forbid_unknown_fields=True):
    """The choice of one of several fleets."""

    fleet: str


class Explained(msgspec.Struct, omit_defaults=True):
    """The answer: an explanation (argosy/why), or the reason why there is none."""

    explanation: Explanation | None = None
    error: str = ""


class ControlRequests:
    """Carries out the orders of this run's pages and keeps the last ones."""

    def __init__(self, link: FleetLink, known: Callable[[], list[str]], rights: Callable[[], str]) -> None:
        self._link, self._known = link, known
        """Returns the robots of the mission, and those that were seen."""
        self._rights = rights
        """Returns why orders are not allowed; empty if they are."""
        self._number = 0
        self.last: deque[OrderedView] = deque(maxlen=KEPT)

    async def stop(self, wish: StopWish) -> OrderedView:
        """Send an order to all robots at the same time and wait for each outcome."""
        bus, fleet = self._link.bus, self._link.fleet
        self._number += 1
        view = OrderedView(
            number=self._number, order=wish.order, at=steady_clock(), clicked=wish.at, state="looking",
            of="all" if wish.robots is None else "",
        )  # fmt: skip
        self.last.append(view)
        problem = (
            late(wish.at)
            or self._rights()
            or misnamed(wish.robots or (), "a robot")
            or (NOBODY if bus is None or not fleet else "")
        )
        if problem or bus is None:
            return self._now(replace(view, problem=problem))
        names = self._known() if wish.robots is None else list(dict.fromkeys(wish.robots))[:ROBOTS]
        orders = {asyncio.create_task(self._order(bus, fleet, name, wish.order)) for name in names}
        view = self._now(replace(view, outcomes=dict.fromkeys(names, WAITING)))
        looking = asyncio.create_task(bridges(bus, fleet))
        try:
            if wish.robots is None:  # also robots not seen before; the known ones have their orders by now
                for more in sorted({robot for _, robot in await looking} - set(names)):
                    orders.add(asyncio.create_task(self._order(bus, fleet, more, wish.order)))
                    view = self._now(replace(view, outcomes=view.outcomes | {more: WAITING}))
            if not orders:
                view = self._now(replace(view, problem="no robot is on the bus"))
                return view
            there = {robot for _, robot in await looking}
            for answer in asyncio.as_completed(orders):
                robot, outcome = await answer
                reason = outcome.reason
                if outcome is UNANSWERED and not bus.router_up:
                    reason = UNREACHED
                elif outcome is UNANSWERED and robot not in there:
                    reason = "its bridge is not on the bus"
                state = "confirmed" if outcome.ok else "NOT confirmed"
                view = self._now(replace(view, outcomes=view.outcomes | {robot: (state, reason)}))
        finally:
            for task in (looking, *orders):
                task.cancel()
            await asyncio.gather(looking, *orders, return_exceptions=True)
            cut = {robot: CUT for robot, shown in view.outcomes.items() if shown == WAITING}
            if cut or not (view.outcomes or view.problem):  # by an error, or the end of this process
                self._now(replace(view, outcomes=view.outcomes | cut, problem="" if cut else CUT[1]))
        return view

    async def _order(self, bus: Bus, fleet: str, robot: str, order: str) -> tuple[str, Outcome]:
        return robot, await order_robot(bus, fleet, robot, order)

    def _now(self, view: OrderedView) -> OrderedView:
        """Show the state of an order on the pages."""
        view = replace(view, state=_state(view))
        for index, one in enumerate(self.last):
            if one.number == view.number:
                self.last[index] = view
        return view

    async def control(self, wish: ControlWish) -> Outcome:
        """Send an order to a mind. Returns the reason if it is refused."""
        bus, fleet = self._link.bus, self._link.fleet
        if why := late(wish.at) or self._rights() or misnamed((wish.agent,), "an agent"):
            return Outcome(ok=False, reason=why)
        if bus is None or not fleet:
            return Outcome(ok=False, reason=NOBODY)
        if len(wish.text) > LONGEST:
            return Outcome(ok=False, reason=f"{len(wish.text)} characters, expected at most {LONGEST}")
        if wish.do in ("goal", "belief") and not wish.text.strip():
            return Outcome(ok=False, reason=f"expected a {wish.do}, such as `go(3,4)`")
        order = MindOrder(do=wish.do, text=wish.text.strip())
        try:
            return await bus.ask_one(keys.control(fleet, wish.agent), order, Outcome, CONTROL_PATIENCE)
        except QueryTimeout:
            return Outcome(ok=False, reason=f"`{wish.agent}` did not answer: is it running?")
        except BusError as error:
            return Outcome(ok=False, reason=str(error))

    async def why(self, wish: WhyWish) -> Explained:
        """Ask an agent why."""
        bus, fleet = self._link.bus, self._link.fleet
        if wrong := misnamed((wish.agent,), "an agent"):
            return Explained(error=wrong)
        if bus is None or not fleet:
            return Explained(error=UNREACHED)
        try:
            return Explained(await explain(bus, fleet, wish.agent, wish.about))
        except (BusClosed, Unanswered) as error:
            return Explained(error=str(error))
        except Findings as findings:
            return Explained(error="; ".join(one.message for one in findings.findings))

    async def choose(self, wish: FleetWish) -> Outcome:
        """Choose one of several fleets."""
        return Outcome(ok=self._link.choose(wish.fleet))


def _state(view: OrderedView) -> Literal["looking", "waiting", "confirmed", "NOT confirmed", "NOT ordered"]:
    states = {state for state, _ in view.outcomes.values()}
    if view.problem:
        return "NOT ordered"
    if not states:
        return "looking"
    return "waiting" if "waiting" in states else "confirmed" if states == {"confirmed"} else "NOT confirmed"


def late(at: float) -> str:
    """Return why an order given `at` that time, in Unix seconds, is refused; empty if it is fresh.

    An order may be delayed while this process, its machine or the connection hangs, and arrive unexpectedly.
    """
    age = steady_clock() - at
    if abs(age) <= LATE:
        return ""
    when = f"{age:.0f} s after it was given" if age > 0 else f"{-age:.0f} s before it was given, by our clock"
    return f"it came {when} and was not carried out: order again"


def misnamed(names: Sequence[str], what: str) -> str:
    """Return which of the names is not valid, as text; empty if all are. A `*` would address everybody."""
    for name in names:
        try:
            check_name(name)
        except ValueError:
            return f"`{name[:64]}` is no name of {what}"
    return ""
