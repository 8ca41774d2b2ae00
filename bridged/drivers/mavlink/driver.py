"""The MAVLink driver: one vehicle on a link, on asyncio. What is said is in `vehicle_session`, the link in `links`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection, Mapping
from contextlib import suppress
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Execution, Order, Outcome, Setup, Value
from bridged.drivers.mavlink.actions.context import Task
from bridged.drivers.mavlink.manifest.action_binding import call_of
from bridged.drivers.mavlink.manifest.capabilities import offer_of
from bridged.drivers.mavlink.manifest.message_fields import unread
from bridged.drivers.mavlink.session import VehicleSession
from bridged.drivers.mavlink.transport.address import LinkAddress, link_strings
from bridged.drivers.mavlink.transport.link import Ids
from bridged.drivers.mavlink.transport.link_state import LinkState
from bridged.drivers.mavlink.transport.shared_links import LinkClient, Links, SharedLink
from bridged.drivers.mavlink.transport.signing import read_key
from bridged.drivers.mavlink.vehicle.descent_actions import leads_down, may_lead_down
from bridged.drivers.mavlink.vehicle.gcs_failsafe import our_ids
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note

TICK, TICKS = 0.25, 2.0
"""At most so many wall seconds between looks at the time, and at least so many looks in a second of the vehicle."""
TICK_IDLE = 1.0
"""Wall seconds between looks at the time while nothing is asked of the vehicle: each look wakes the process, and our
heartbeats go out when the vehicle's come in."""
STALL = 1.0
"""Wall seconds that a tick may be late; after that the vehicle's packets are read before its silence is judged."""
CATCH_UP = 0.2
"""Wall seconds to read what came meanwhile."""
log = logging.getLogger("mavlink")


class Carrier(Protocol):
    """What carries packets to the vehicle: a link with other robots at it, or the air of a test."""

    def send(self, message: dialect.MAVLink_message, sysid: int | None = None) -> bool: ...


class MavlinkDriver:
    """A `bridged.drivers.api.Driver`."""

    orders: frozenset[Order] = frozenset(("hold", "land", "rtl"))

    def __init__(self, setup: Setup) -> None:
        """Raises SigningError for a passphrase that cannot be used."""
        robot, clock = setup.robot, setup.clock
        self._address = LinkAddress.parse(robot.link)
        self._clock = clock
        self._on_step = setup.on_step
        self._links = Links.of(setup.shared)
        self._link: SharedLink | None = None
        self._asked = asyncio.Event()
        """Something was asked of the vehicle: look at the time more often at once."""
        self._carrier: Carrier | None = None
        self.identity = our_ids(robot.failsafe, robot.sysid, robot.ids)
        """Under which ids we speak, and to whom."""
        self._link_client = LinkClient(
            setup.name,
            robot.sysid,
            Ids(self.identity.system, self.identity.component),
            lambda message, peer: self.receive(message),
            self._carry,
            unread(setup.manifest),
            None if robot.signing is None else read_key(setup.folder / robot.signing.passphrase_file),
            tuple(map(LinkAddress.parse, link_strings(robot.forward))),
            setup.state,
        )
        self._state = LinkState(setup.on_reading)
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
        self._patience = self._be_patient(setup.manifest)

    async def run(self) -> None:
        """Carry the vehicle's traffic until cancelled. Raises LinkError if the link cannot be opened: run it again."""
        loop = asyncio.get_running_loop()
        self._carry(False)  # so that a link that cannot be opened, also when this is run again, is told to be down
        async with self._links.seat(self._address, self._link_client) as self._link:
            self._carry(self._link.up)
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
                    log.warning("this process stood still for %.1f s", late)
                    await asyncio.sleep(CATCH_UP)

    def attach(self, carrier: Carrier) -> None:
        """Send by this carrier from now on."""
        self._carrier = carrier

    def receive(self, message: dialect.MAVLink_message) -> None:
        """Take in a message from the carrier."""
        self._vehicle_session.receive(message, self._clock.now())
        self._look()

    def tick(self) -> None:
        """Let time pass."""
        self._vehicle_session.tick(self._clock.now())
        self._look()

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

        Of two vehicles that cannot be told apart none is armed or moved; one that flies is left its ways down.
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
        """Begin an order from above; every action that runs ends as `ending`."""
        self._asked.set()
        return self._vehicle_session.order(order, ending, insist=insist)

    def pause(self, interrupted: Collection[Execution]) -> Execution:
        """Hold the vehicle by its mode; on `resume` it goes on in the mode before."""
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
        """Armed, as far as is known; a vehicle that fell silent while armed counts as armed."""
        return self._vehicle_session.vehicle.armed

    @property
    def heard(self) -> bool:
        """Whether its HEARTBEATs come."""
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
        """Go on by another manifest: other streams are asked for."""
        self._vehicle_session.adopt(manifest)
        self._link_client.unread = unread(manifest)
        self._patience = self._be_patient(manifest)

    def speak_for_agent(self, present: bool) -> None:
        """Without an agent, heartbeats that claim to be the ground station stop."""
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
        return counters if self._link is None else counters | self._link.counters(self._link_client)

    def notes(self) -> list[Note]:
        """Warnings that hold now."""
        of_link = [] if self._link is None else self._link.notes(self._link_client)
        return [*of_link, *self._vehicle_session.notes()]

    def _look(self) -> None:
        talk = self._vehicle_session
        self._state.look(talk.vehicle.connected, talk.vehicle.heard_at, self._clock.now(), self._patience)
        self._on_step()

    def _carry(self, up: bool) -> None:
        self._state.carry(up, self._clock.now())
        self._look()

    def _two(self) -> str:
        """The warning that two vehicles have the id of ours, empty if there is one."""
        return "" if self._link is None else self._link_client.address.two_vehicles(asyncio.get_running_loop().time())

    def _be_patient(self, manifest: Manifest) -> float:
        """Mission seconds of silence that are a link loss; the judgement of the vehicle's address goes by them too."""
        flight, limit = self._vehicle_session.flight, manifest.robot.link_loss
        patience = flight.wait(limit, limit)
        self._link_client.address.link_loss = flight.to_wall(patience)
        return patience

    def _send(self, message: dialect.MAVLink_message) -> None:
        try:
            if self._carrier is not None:
                self._carrier.send(message, self.identity.vehicle)
            elif self._link is not None:
                send = self._link.send_everywhere if self._two() else self._link.send
                send(self._link_client, message)
        except ValueError as error:
            self.unsendable += 1
            log.error("not sent: %s", error)
