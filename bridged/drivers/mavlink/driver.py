"""The MAVLink driver: one vehicle on one link, on asyncio. What is said is in `conversation`."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.conversation import Conversation
from bridged.drivers.mavlink.failsafe import our_ids
from bridged.drivers.mavlink.flight import Task
from bridged.drivers.mavlink.link import Link, LinkAddress, Peer, open_link
from bridged.drivers.mavlink.procedures import PROCEDURES
from bridged.drivers.mavlink.twins import Twins
from bridged.drivers.mavlink.vocabulary import call_of
from bridged.drivers.robot import Execution, OnReading, Order, Outcome, Value
from commd.clock import Clock
from schemas.manifest import ActionEntry, Manifest
from schemas.mission import Robot

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
    """What carries packets to the vehicle: a `Link`."""

    def send(self, message: dialect.MAVLink_message, sysid: int | None = None) -> bool: ...


class MavlinkDriver:
    """A `bridged.drivers.robot.Driver`."""

    orders: frozenset[Order] = frozenset(("hold", "land", "rtl"))

    def __init__(
        self, manifest: Manifest, robot: Robot, clock: Clock, on_reading: OnReading, on_step: Callable[[], None]
    ) -> None:
        self._address = LinkAddress.parse(robot.link)
        self._clock = clock
        self._on_step = on_step
        self._link: Link | None = None
        self._asked = asyncio.Event()
        """Something was asked of the vehicle: look at the time more often at once."""
        self._carrier: Carrier | None = None
        self.identity = our_ids(robot.failsafe, robot.sysid)
        """Under which ids we speak, and to whom."""
        self._twins = Twins(robot.sysid)
        self.unsendable = 0
        """Messages so far that could not be packed."""
        self.stalls = 0
        """How often so far the event loop was away for longer than `STALL`."""
        self._conversation = Conversation(
            manifest,
            self.identity,
            self._send,
            on_reading,
            speed=clock.speed,
            limits=robot.limits,
            failsafe=robot.failsafe,
        )

    async def run(self) -> None:
        """Carry the vehicle's traffic until cancelled. Raises LinkError if the link cannot be opened."""
        loop = asyncio.get_running_loop()
        link = self._link = await open_link(
            self._address,
            self._receive_from,
            system=self.identity.system,
            component=self.identity.component,
            on_state=lambda up, why: log.info("link %s %s: %s", self._address, "up" if up else "down", why),
        )
        self.attach(link)
        try:
            while True:
                try:
                    self.tick()
                except Exception as error:  # a defect must not take the link down, and with it the way home
                    loop.call_exception_handler({"message": "looking at the vehicle", "exception": error})
                at_work = self._conversation.streams.at_work
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
        finally:
            await link.close()
            self._link = self._carrier = None

    def attach(self, carrier: Carrier) -> None:
        """Send by this carrier from now on."""
        self._carrier = carrier

    def receive(self, message: dialect.MAVLink_message) -> None:
        """Take in a message from the carrier."""
        self._conversation.receive(message, self._clock.now())
        self._on_step()

    def tick(self) -> None:
        """Let time pass."""
        self._conversation.tick(self._clock.now())
        self._on_step()

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin an action of the manifest."""
        sets_mode = entry.confirm == "mode"
        task = Task(name, moves=entry.motion, sets_mode=sets_mode, takes_control=sets_mode)
        try:
            call = call_of(entry, arguments, self._conversation.modes)
        except ValueError as error:
            task.end(Outcome("refused", str(error)))
            return task
        self._asked.set()
        return self._conversation.begin(task, PROCEDURES[entry.confirm], call)

    def refuses(self, entry: ActionEntry) -> str:
        """Why an action cannot begin now, empty if it can; setting the mode takes control again.

        Of two vehicles that cannot be told apart none is armed; one that flies already is not left without a way down.
        """
        if entry.confirm == "armed" and not self.active and (twins := self._twins.notes(self._clock.wall())):
            return twins[0]
        mode = self._conversation.override
        if not mode or entry.confirm == "mode":
            return ""
        who = "(pilot, ground station or failsafe)"
        return f"override: others have set {mode} {who}; an agent takes control again by setting the mode"

    def order(self, order: Order, reason: str, *, insist: bool) -> Execution:
        """Begin an order from above; every action that runs fails with `reason`."""
        self._asked.set()
        return self._conversation.order(order, reason, insist=insist)

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution now."""
        if isinstance(execution, Task):
            self._conversation.end(execution, outcome, hold=hold)

    @property
    def active(self) -> bool:
        """Armed, as far as is known; a vehicle that fell silent while armed counts as armed."""
        return self._conversation.vehicle.armed

    @property
    def heard(self) -> bool:
        """Whether its HEARTBEATs come."""
        return self._conversation.vehicle.connected

    @property
    def silence(self) -> float:
        """Wall seconds since its last HEARTBEAT."""
        return self._conversation.silence

    @property
    def overridden(self) -> str:
        """The mode of an armed vehicle in which others have set it; empty if nobody has."""
        talk = self._conversation
        return talk.vehicle.mode_name if talk.overridden and talk.vehicle.armed else ""

    def adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest: other streams are asked for."""
        self._conversation.adopt(manifest)

    def speak_for_agent(self, present: bool) -> None:
        """Without an agent, heartbeats that claim to be the ground station stop."""
        self._conversation.speaks_for_agent = present

    def counters(self) -> dict[str, float]:
        """Figures for health."""
        talk = self._conversation
        counters: dict[str, float] = {
            "messages": talk.received,
            "commands_repeated": talk.commands.repeated,
            "acks_unmatched": talk.commands.unmatched,
            "streams_requested": talk.streams.requested,
            "reboots": talk.vehicle.reboots,
            "unsendable": self.unsendable,
            "stalls": self.stalls,
        }
        if self._link is not None:
            came = self._link.counters
            counters |= {
                "bad_checksums": came.bad_checksums,
                "skipped_bytes": came.skipped_bytes,
                "unknown_packets": came.unknown_packets,
                "unreadable_packets": came.unreadable_packets,
                "link_dropped": came.dropped,
                "link_reopened": came.reopened,
            }
        return counters

    def notes(self) -> list[str]:
        """Warnings that hold now."""
        link = self._link
        down = [f"link {self._address} is down: {link.why}"] if link is not None and not link.up else []
        return down + self._twins.notes(self._clock.wall()) + self._conversation.notes()

    def _receive_from(self, message: dialect.MAVLink_message, peer: Peer) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.get_type() == "HEARTBEAT" and sender == (self.identity.vehicle, self.identity.autopilot):
            self._twins.heard(str(peer), self._clock.wall())
        self.receive(message)

    def _send(self, message: dialect.MAVLink_message) -> None:
        if self._carrier is None:
            return
        try:
            self._carrier.send(message, self.identity.vehicle)
        except ValueError as error:
            self.unsendable += 1
            log.error("not sent: %s", error)
