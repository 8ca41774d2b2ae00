"""What operators read and set of a vehicle, on the bus: its parameters and its stored mission."""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from bridged.drivers.api import Driver, Execution, Outcome, VehicleStore
from commd.bus.bus import Bus, Query
from commd.bus.errors import CannotServe
from commd.common.tasks import wait_at_most
from schemas.liveness import STATUS_EVERY
from schemas.wire import keys
from schemas.wire.records import Record
from schemas.wire.vehicle_records import ParameterRequest, PlanItem, StoredPlan, VehicleParameters

AT_MOST = 300.0
"""Wall seconds of one request. A driver gives up earlier a vehicle that falls silent."""
REQUEST_BYTES = 1000
"""A larger request is refused unread."""
BY_HAND = "a parameter is set by hand, which this mission does not allow; `inject: true` in the mission file allows it"
log = logging.getLogger("bridged")


class VehicleRequests:
    """Answers for the vehicle of one robot."""

    def __init__(self, bus: Bus, robot: str, driver: Driver, inject: bool) -> None:
        """`inject`: the mission allows what is done by hand."""
        self._bus, self._robot, self._driver, self._inject = bus, robot, driver, inject
        self._busy = False
        """A request is being carried out; another one would share its link."""

    def open(self) -> None:
        """Begin to serve."""
        bus, most = self._bus, REQUEST_BYTES
        bus.serve(keys.parameters(bus.fleet, self._robot), ParameterRequest, self._parameters, at_most=most)
        bus.serve(keys.stored_plan(bus.fleet, self._robot), StoredPlan, self._plan, at_most=most)

    async def _parameters(self, query: Query[ParameterRequest]) -> None:
        """Answer with all parameters, or set the one of the request: then the last reply has its value."""
        if query.error:
            raise CannotServe(query.error)
        request, values = query.record, dict[str, float]()
        if request is None:
            outcome = await self._follow(query, lambda store: store.read_parameters(values), _parameters_so_far)
        else:
            outcome = await self._set(query, request)
            values = {request.name: request.value}
        succeeded = outcome.state == "succeeded"
        finite = {name: value for name, value in sorted(values.items()) if succeeded and math.isfinite(value)}
        query.reply(
            VehicleParameters(
                header=self._bus.header("parameters", self._robot),
                values=finite,
                left_out=tuple(sorted(values.keys() - finite.keys())) if succeeded else (),
                came=len(values),
                of=len(values),
                done=True,
                problem="" if succeeded else outcome.reason,
                cause=None if succeeded else outcome.cause,
            )
        )

    async def _set(self, query: Query[ParameterRequest], request: ParameterRequest) -> Outcome:
        """Set a parameter if the mission allows it, and log how that ended."""
        name, value, allow = request.name, request.value, request.allow_safety
        if self._inject:
            outcome = await self._follow(
                query, lambda store: store.set_parameter(name, value, allow_safety=allow), _parameters_so_far
            )
        else:
            outcome = Outcome("refused", BY_HAND, "rights")
        ended = f"{outcome.state} {outcome.reason}".rstrip()
        log.info("robot=%s parameter %s = %g by hand: %s", self._robot, name, value, ended)
        return outcome

    async def _plan(self, query: Query[StoredPlan]) -> None:
        """Answer with the mission that the vehicle stores."""
        items: list[PlanItem] = []
        outcome = await self._follow(query, lambda store: store.read_plan(items), _items_so_far)
        succeeded = outcome.state == "succeeded"
        autopilot, vehicle = self._driver.identified_as if isinstance(self._driver, VehicleStore) else (0, 0)
        query.reply(
            StoredPlan(
                header=self._bus.header("stored_plan", self._robot),
                items=tuple(items) if succeeded else (),
                autopilot=autopilot,
                vehicle=vehicle,
                came=len(items),
                of=len(items),
                done=True,
                problem="" if succeeded else outcome.reason,
            )
        )

    async def _follow(
        self, query: Query[Any], begin: Callable[[VehicleStore], Execution], progress: Callable[[Execution], Record]
    ) -> Outcome:
        """Begin an execution and reply its progress until its end. Raises CannotServe if the driver has none."""
        driver = self._driver
        if not isinstance(driver, VehicleStore):
            raise CannotServe("its driver knows no parameters and no stored mission")
        if not query.concrete:
            raise CannotServe("expected the key of one robot")
        if not driver.heard:
            return Outcome("refused", "the vehicle is not heard", "link")
        if self._busy:
            return Outcome("refused", "another request of an operator is being carried out; try again later", "busy")
        self._busy = True
        try:
            execution, ended = begin(driver), asyncio.Event()
            execution.on_end(ended.set)
            with suppress(TimeoutError):
                async with asyncio.timeout(AT_MOST):
                    while not ended.is_set():
                        await wait_at_most(ended, STATUS_EVERY)
                        if not ended.is_set():
                            query.reply(progress(execution))
            waited = f"; it waited for {execution.waits_for}" if execution.waits_for else ""
            late = Outcome("timed_out", f"not done within {AT_MOST:g} s{waited}", "deadline")
            if not execution.over:
                driver.stop(execution, late, hold=False)
            return execution.outcome or late
        finally:
            self._busy = False


def _parameters_so_far(execution: Execution) -> VehicleParameters:
    return VehicleParameters(came=_figure(execution, "params"), of=_figure(execution, "of"))


def _items_so_far(execution: Execution) -> StoredPlan:
    return StoredPlan(came=_figure(execution, "item"), of=_figure(execution, "items"))


def _figure(execution: Execution, name: str) -> int:
    return int(execution.feedback.get(name, 0))
