"""The MAVLink driver: the session with one vehicle, on a link."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Mapping

from bridged.drivers.api import SAFETY, Execution, Order, Outcome, Setup, Value
from bridged.drivers.mavlink.action_binding import bind_action, leads_down, may_lead_down, procedure_of
from bridged.drivers.mavlink.actions import operator_requests
from bridged.drivers.mavlink.actions.context import Files, Plan, ProcedureRun
from bridged.drivers.mavlink.session import VehicleSession
from bridged.drivers.mavlink.transport.address import LinkAddress, link_strings
from bridged.drivers.mavlink.transport.link import Ids
from bridged.drivers.mavlink.transport.shared_links import LinkClient, shared_link
from bridged.drivers.mavlink.transport.signing import read_key
from bridged.drivers.mavlink.vehicle.gcs_failsafe import our_ids
from bridged.drivers.mavlink.vehicle.streams import unread
from commd.common.tasks import in_step, wait_at_most
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note
from schemas.wire.vehicle_records import PlanItem

TICK, TICKS = 0.25, 2.0
"""Most wall seconds between two ticks, and least ticks in a mission second."""
TICK_IDLE = 1.0
"""Wall seconds between two ticks while nothing is asked of the vehicle: each one wakes the process, and our heartbeats
go out when the vehicle's come in."""
STALL = 1.0
"""Wall seconds that a tick may be late; after that the vehicle's packets are read before its silence is judged."""
CATCH_UP = 0.2
"""Wall seconds to read the packets that arrived meanwhile."""
log = logging.getLogger("mavlink")


class MavlinkDriver(VehicleSession):
    """A `bridged.drivers.api.Driver`: a session with a vehicle on a link."""

    orders: frozenset[Order] = frozenset(SAFETY)

    def __init__(self, setup: Setup) -> None:
        """Raises SigningError for a passphrase that cannot be used."""
        robot = setup.robot
        identity = our_ids(robot.failsafe, robot.sysid, robot.ids)
        self.link_client = LinkClient(
            setup.name,
            robot.sysid,
            Ids(identity.system, identity.component),
            self.receive,
            self.carry,
            unread(setup.manifest),
            None if robot.signing is None else read_key(setup.folder / robot.signing.passphrase_file),
            tuple(map(LinkAddress.parse, link_strings(robot.forward))),
            setup.state,
        )
        """Carries packets to the vehicle, over a link that other robots may share."""
        super().__init__(
            setup.manifest,
            identity,
            self.link_client.send,
            setup.on_reading,
            setup.clock,
            limits=robot.limits,
            failsafe=robot.failsafe,
        )
        self.flight.files = Files(setup.name, setup.folder, setup.logs)
        self.flight.plan = Plan(setup.state / f"{setup.name}.mission_broken")
        self.streams.others_listen = bool(robot.forward)
        self._address = LinkAddress.parse(robot.link)
        self._on_turn = setup.on_turn
        self._shared = setup.shared
        self.link_client.address.link_loss = self.flight.to_wall(self.link_loss)
        self.stalls = 0
        """How often so far the event loop was away for longer than `STALL`."""

    async def run(self) -> None:
        """Carry the vehicle's traffic until cancelled. Raises LinkError if it cannot be opened; may be run again."""
        loop = asyncio.get_running_loop()
        self.carry(False)  # so that a link that cannot be opened, also at another run, is reported down
        async with shared_link(self._shared, self._address, self.link_client) as link:
            self.carry(link.up)
            while True:
                try:
                    self.tick()
                    self._on_turn()
                except Exception as error:  # a defect must not take the link down, and with it the way home
                    loop.call_exception_handler({"message": "looking at the vehicle", "exception": error})
                pause = min(TICK, 1 / (TICKS * self.clock.speed)) if self.streams.at_work else TICK_IDLE
                pause = in_step(loop.time(), pause)
                due = loop.time() + pause
                self.asked.clear()
                await wait_at_most(self.asked, pause)
                if (late := loop.time() - due) > STALL:
                    self.stalls += 1
                    log.warning("this process was blocked for %.1f s", late)
                    await asyncio.sleep(CATCH_UP)

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action of the manifest."""
        try:
            action = bind_action(entry, arguments, self.vehicle.modes)
        except ValueError as error:
            return Execution(name, Outcome("refused", str(error)))
        if (two := self._two()) and not leads_down(entry, action, self.vehicle.modes):
            return Execution(name, Outcome("refused", two))
        procedure = procedure_of(entry, action.number)
        return self.begin(
            ProcedureRun(
                name,
                procedure=procedure,
                action=action,
                bind=lambda: bind_action(entry, arguments, self.vehicle.modes),
                moves=entry.motion,
                by_agent=True,
            )
        )

    def refuses(self, entry: ActionEntry) -> Outcome | None:
        """Why an action cannot begin now; None if it can. Setting the mode takes control again.

        Of two vehicles with one system id none is armed or moved; one that flies may still come down.
        """
        if refusal := self.vehicle.not_commanded:
            return Outcome("refused", refusal)
        if (two := self._two()) and not (self.active and may_lead_down(entry)):
            return Outcome("refused", two)
        mode = self.control.override
        if not mode or entry.confirm == "mode":
            return None
        who = "(pilot, ground station or failsafe)"
        reason = f"override: others have set {mode} {who}; an agent takes control again by setting the mode"
        return Outcome("refused", reason, "pilot")

    def read_parameters(self, into: dict[str, float]) -> Execution:
        """Read every parameter of the vehicle; none becomes a percept."""
        return self.begin(operator_requests.read_parameters(into))

    def set_parameter(self, name: str, value: float, *, allow_safety: bool) -> Execution:
        """Set a parameter of a vehicle that is not armed."""
        if two := self._two():
            return Execution(name, Outcome("refused", two))
        return self.begin(operator_requests.set_parameter(name, value, allow_safety=allow_safety))

    def read_plan(self, into: list[PlanItem]) -> Execution:
        """Read the mission that the vehicle stores, home first; its items become no percepts."""
        return self.begin(operator_requests.read_plan(into))

    @property
    def identified_as(self) -> tuple[int, int]:
        """MAV_AUTOPILOT and MAV_TYPE of the vehicle's HEARTBEAT; 0 while they are not known."""
        return self.vehicle.autopilot or 0, self.vehicle.type

    @property
    def active(self) -> bool:
        """Whether it is armed; a vehicle that fell silent while armed counts as armed."""
        return self.vehicle.armed

    @property
    def heard(self) -> bool:
        """Whether its HEARTBEATs arrive."""
        return self.vehicle.connected

    @property
    def airborne(self) -> bool:
        """Armed and off the ground; a rover never is."""
        return self.vehicle.aloft and not self.vehicle.modes.ground

    @property
    def under_way(self) -> Order | None:
        """The order that its mode carries out while it is armed."""
        vehicle = self.vehicle
        return vehicle.modes.order_of(vehicle.mode) if vehicle.connected and vehicle.armed else None

    @property
    def overridden(self) -> str:
        """The mode of an armed vehicle in which others have set it; empty if nobody has."""
        theirs = self.vehicle.overridden or self.vehicle.not_commanded
        return self.vehicle.mode_name if theirs and self.vehicle.armed else ""

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest: other streams are requested."""
        super().adopt(manifest)
        self.link_client.unread = unread(manifest)
        self.link_client.address.link_loss = self.flight.to_wall(self.link_loss)

    def counters(self) -> dict[str, float]:
        """Figures for health."""
        counters: dict[str, float] = {
            "messages": self.received,
            "commands_repeated": self.commands.repeated,
            "acks_unmatched": self.commands.unmatched,
            "streams_requested": self.streams.requested,
            "reboots": self.vehicle.reboots,
            "texts_dropped": self.warnings.dropped,
            "unsendable": self.link_client.unsendable,
            "stalls": self.stalls,
        }
        return counters | (self.link_client.link.counters(self.link_client) if self.link_client.link else {})

    def notes(self) -> list[Note]:
        """Warnings that hold now."""
        link = self.link_client.link
        return [*(link.notes(self.link_client) if link else ()), *super().notes()]

    def _two(self) -> str:
        """Return the warning that two vehicles have the system id of ours, empty if there is one."""
        return self.link_client.address.two_vehicles(time.monotonic())
