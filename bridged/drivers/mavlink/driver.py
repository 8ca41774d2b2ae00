"""The MAVLink driver: one vehicle on a link. What is exchanged with it is in `session`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection, Mapping
from contextlib import suppress

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Execution, Order, Outcome, Setup, Value
from bridged.drivers.mavlink.action_binding import call_of, leads_down, may_lead_down, offer_of
from bridged.drivers.mavlink.actions.context import Task
from bridged.drivers.mavlink.session import VehicleSession
from bridged.drivers.mavlink.transport.address import LinkAddress, link_strings
from bridged.drivers.mavlink.transport.link import Ids
from bridged.drivers.mavlink.transport.shared_links import LinkClient, Links, SharedLink
from bridged.drivers.mavlink.transport.signing import read_key
from bridged.drivers.mavlink.vehicle.gcs_failsafe import our_ids
from bridged.drivers.mavlink.vehicle.streams import unread
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note

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


class MavlinkDriver:
    """A `bridged.drivers.api.Driver`."""

    orders: frozenset[Order] = frozenset(("hold", "land", "rtl"))

    def __init__(self, setup: Setup) -> None:
        """Raises SigningError for a passphrase that cannot be used."""
        robot, clock = setup.robot, setup.clock
        self._address = LinkAddress.parse(robot.link)
        self._clock = clock
        self._on_turn = setup.on_turn
        self._links = Links.of(setup.shared)
        self.link: SharedLink | None = None
        """Carries packets to the vehicle; shared with other robots at it."""
        self._asked = asyncio.Event()
        """Something was asked of the vehicle: tick immediately, and more often."""
        self.identity = our_ids(robot.failsafe, robot.sysid, robot.ids)
        """Our MAVLink ids, and the vehicle's."""
        self._link_client = LinkClient(
            setup.name,
            robot.sysid,
            Ids(self.identity.system, self.identity.component),
            self.receive,
            self._carry,
            unread(setup.manifest),
            None if robot.signing is None else read_key(setup.folder / robot.signing.passphrase_file),
            tuple(map(LinkAddress.parse, link_strings(robot.forward))),
            setup.state,
        )
        self.unsendable = 0
        """Messages so far that could not be packed."""
        self.stalls = 0
        """How often so far the event loop was away for longer than `STALL`."""
        self._vehicle_session = VehicleSession(
            setup.manifest,
            self.identity,
            self._send,
            setup.on_reading,
            speed=clock.speed,
            limits=robot.limits,
            failsafe=robot.failsafe,
        )
        self._judge_address()

    async def run(self) -> None:
        """Carry the vehicle's traffic until cancelled. Raises LinkError if it cannot be opened; may be run again."""
        loop = asyncio.get_running_loop()
        self._carry(False)  # so that a link that cannot be opened, also at another run, is reported down
        async with self._links.seat(self._address, self._link_client) as self.link:
            self._carry(self.link.up)
            while True:
                try:
                    self.tick()
                except Exception as error:  # a defect must not take the link down, and with it the way home
                    loop.call_exception_handler({"message": "looking at the vehicle", "exception": error})
                at_work = self._vehicle_session.streams.at_work
                pause = min(TICK, 1 / (TICKS * self._clock.speed)) if at_work else TICK_IDLE
                due = loop.time() + pause
                self._asked.clear()
                with suppress(TimeoutError):
                    async with asyncio.timeout(pause):
                        await self._asked.wait()
                if (late := loop.time() - due) > STALL:
                    self.stalls += 1
                    log.warning("this process was blocked for %.1f s", late)
                    await asyncio.sleep(CATCH_UP)

    def receive(self, message: dialect.MAVLink_message) -> None:
        """Take in a message from the link."""
        self._vehicle_session.receive(message, self._clock.now())

    def tick(self) -> None:
        """Let time pass."""
        self._vehicle_session.tick(self._clock.now())
        self._on_turn()

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action of the manifest."""
        task = Task(name, moves=entry.motion)
        modes = self._vehicle_session.modes
        try:
            call = call_of(entry, arguments, modes)
        except ValueError as error:
            task.end(Outcome("refused", str(error)))
            return task
        if (two := self._two()) and not leads_down(entry, call, modes):
            task.end(Outcome("refused", two))
            return task
        self._asked.set()
        return self._vehicle_session.perform(task, offer_of(entry, call.number), call)

    def refuses(self, entry: ActionEntry) -> Outcome | None:
        """Why an action cannot begin now; None if it can. Setting the mode takes control again.

        Of two vehicles with one system id none is armed or moved; one that flies may still come down.
        """
        if refusal := self._vehicle_session.vehicle.not_commanded:
            return Outcome("refused", refusal)
        if (two := self._two()) and not (self.active and may_lead_down(entry)):
            return Outcome("refused", two)
        mode = self._vehicle_session.control.override
        if not mode or entry.confirm == "mode":
            return None
        who = "(pilot, ground station or failsafe)"
        said = f"override: others have set {mode} {who}; an agent takes control again by setting the mode"
        return Outcome("refused", said, "pilot")

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> Execution:
        """Begin an order above the agents; every running action ends as `ending`."""
        self._asked.set()
        return self._vehicle_session.order(order, ending, insist=insist)

    def pause(self, interrupted: Collection[Execution]) -> Execution:
        """Hold the vehicle by its mode until `resume`."""
        self._asked.set()
        return self._vehicle_session.pause([task for task in interrupted if isinstance(task, Task)])

    def resume(self) -> Execution:
        """Set the mode before the pause."""
        self._asked.set()
        return self._vehicle_session.resume()

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution now."""
        if isinstance(execution, Task):
            self._vehicle_session.end(execution, outcome, hold=hold)

    @property
    def active(self) -> bool:
        """Whether it is armed; a vehicle that fell silent while armed counts as armed."""
        return self._vehicle_session.vehicle.armed

    @property
    def heard(self) -> bool:
        """Whether its HEARTBEATs arrive."""
        return self._vehicle_session.vehicle.connected

    @property
    def silence(self) -> float:
        """Wall seconds since its last HEARTBEAT."""
        return self._vehicle_session.silence

    @property
    def airborne(self) -> bool:
        """Armed and off the ground; a rover never is."""
        vehicle = self._vehicle_session.vehicle
        return vehicle.aloft and not vehicle.modes.ground

    @property
    def under_way(self) -> Order | None:
        """The order that its mode carries out while it is armed."""
        vehicle = self._vehicle_session.vehicle
        return vehicle.modes.order_of(vehicle.mode) if vehicle.connected and vehicle.armed else None

    @property
    def overridden(self) -> str:
        """The mode of an armed vehicle in which others have set it; empty if nobody has."""
        talk = self._vehicle_session
        theirs = talk.control.overridden or talk.vehicle.not_commanded
        return talk.vehicle.mode_name if theirs and talk.vehicle.armed else ""

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest: other streams are requested."""
        self._vehicle_session.adopt(manifest)
        self._link_client.unread = unread(manifest)
        self._judge_address()

    def speak_for_agent(self, present: bool) -> None:
        """Send heartbeats that claim to be the ground station only while an agent is present."""
        self._vehicle_session.speaks_for_agent = present

    def counters(self) -> dict[str, float]:
        """Figures for health."""
        talk = self._vehicle_session
        counters: dict[str, float] = {
            "messages": talk.received,
            "commands_repeated": talk.commands.repeated,
            "acks_unmatched": talk.commands.unmatched,
            "streams_requested": talk.streams.requested,
            "reboots": talk.vehicle.reboots,
            "texts_dropped": talk.warnings.dropped,
            "unsendable": self.unsendable,
            "stalls": self.stalls,
        }
        return counters if self.link is None else counters | self.link.counters(self._link_client)

    def notes(self) -> list[Note]:
        """Warnings that hold now."""
        of_link = [] if self.link is None else self.link.notes(self._link_client)
        return [*of_link, *self._vehicle_session.notes()]

    def _carry(self, up: bool) -> None:
        """Take in that packets can pass, or that they cannot."""
        self._vehicle_session.carry(up, self._clock.now())

    def _two(self) -> str:
        """Return the warning that two vehicles have the system id of ours, empty if there is one."""
        return "" if self.link is None else self.link.two_vehicles(self._link_client)

    def _judge_address(self) -> None:
        """Judge the vehicle's address by the silence that is a link loss."""
        session = self._vehicle_session
        self._link_client.address.link_loss = session.flight.to_wall(session.link_loss)

    def _send(self, message: dialect.MAVLink_message) -> None:
        if self.link is None:
            return
        try:
            self.link.send(self._link_client, message)
        except ValueError as error:
            self.unsendable += 1
            log.error("not sent: %s", error)
