"""The bridge of one robot, put together: driver, percepts, actions. No bus: what it says goes to two callbacks."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from bridged.bridge.action_log import ActionLog
from bridged.bridge.action_server import ActionServer
from bridged.bridge.composite_driver import CompositeDriver
from bridged.bridge.lease import Lease
from bridged.bridge.live_manifest import RunningManifest
from bridged.bridge.percepts import PerceptPublisher, Publish
from bridged.bridge.robot_setup import order_findings
from bridged.bridge.safety_orders import SafetyOrders
from bridged.drivers.api import Setup
from commd.bus.bus import Bus
from commd.common.clock import Clock
from commd.process.systemd import Loop
from schemas.manifest.loader import Manifest
from schemas.manifest.rules import FUNCTOR
from schemas.mission.model import Mission
from schemas.wire.records import ActionStatus, Health, Note
from schemas.wire.terms import Atom

UNREADABLE = ("bad_checksums", "unreadable_packets", "samples_unreadable")
"""Counters of drivers that are bad input."""
log = logging.getLogger("bridged")


class Bridge:
    """One robot between its driver and its agents."""

    def __init__(
        self,
        mission: Mission,
        robot: str,
        manifest: Manifest,
        clock: Clock,
        ledger: Path,
        publish_percept: Publish,
        publish_status: Callable[[str, ActionStatus], None],
        *,
        boot: str,
        bus: Bus | None = None,
        simulated: bool = False,
        shared: dict[str, Any] | None = None,
        loop: Loop | None = None,
    ) -> None:
        """`shared` is what the drivers of one process share; each look at the robot is a beat of `loop`.

        Raises OSError if the ledger cannot be opened, ValueError for what a driver cannot use.
        """
        self.name = robot
        self._clock = clock
        agents = mission.agents_of(robot)
        speed = clock.speed
        self.board = PerceptPublisher(
            manifest, agents, publish_percept, robot=robot, boot=boot, stamp=clock.stamp, speed=speed
        )
        self.driver = CompositeDriver(
            Setup(
                name=robot,
                manifest=manifest,
                robot=mission.robots[robot],
                folder=mission.path.parent,
                clock=clock,
                on_reading=lambda reading: self.board.take(reading, clock.now()),
                on_step=self.step,
                bus=bus,
                state=ledger.parent,
                simulated=simulated,
                shared={} if shared is None else shared,
            ),
            loop or Loop.unwatched(),
        )
        self.ledger = ActionLog(ledger)
        self.lease = Lease(agents, mission.robots[robot].lease.priority, self._lease_changed, arms=self.driver.arms)
        self.action_server = ActionServer(
            manifest,
            self.driver,
            self.board,
            self.ledger,
            publish_status,
            self.lease,
            robot=robot,
            boot=boot,
            stamp=clock.stamp,
            now=clock.now,
            speed=speed,
        )
        self.live = RunningManifest(manifest, self._adopt, partial(order_findings, mission, robot))
        self.orders = SafetyOrders(self.action_server, self.driver, clock, mission.robots[robot].idle_after)
        self.lease.restore(*self.ledger.held())  # whoever had the robot in our last life is still answered for
        if self.lease.answers:
            self.driver.may_be_moving()
        self._tell_holder()

    def _adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest. Raises what the drivers raise, before anything else has changed."""
        self.driver.adopt(manifest)
        self.board.adopt(manifest)
        self.action_server.adopt(manifest)

    def _lease_changed(self) -> None:
        log.info("robot=%s %s", self.name, f"held by {self.lease.holder}" if self.lease.holder else "free")
        try:
            self.ledger.hold(self.lease.answers, self.lease.free)
        except OSError as error:
            log.error("robot=%s who has it cannot be kept on disk: %s", self.name, error.strerror)
        self._tell_holder()

    def _tell_holder(self) -> None:
        """Let the agents that share the robot perceive which of them has it."""
        if len(self.board.sets) < 2:
            return
        holder = self.lease.holder
        for agent in self.board.sets:
            if holder:
                self.board.show(agent, "holder", (Atom(holder if FUNCTOR.fullmatch(holder) else f"'{holder}'"),))
            else:
                self.board.withdraw(agent, "holder")

    def step(self) -> None:
        """After the driver has looked at the robot: age percepts, pass on what became of actions."""
        self.board.tick(self._clock.now())
        self.action_server.step()

    def health(self) -> Health:
        """Figures and warnings for the bus."""
        counters = self.driver.counters() | {
            "percepts_expired": self.board.expired,
            "percepts_unreadable": self.board.translator.unreadable,
            "actions_running": len(self.action_server.running),
            "manifest_version": self.live.version,
        }
        return Health(
            drops=self.board.dropped + int(counters.get("link_dropped", 0)),
            bad_input=int(sum(counters.get(name, 0) for name in UNREADABLE)),
            counters=counters,
            percepts={agent: present.digest() for agent, present in self.board.sets.items()},
            paused=self.action_server.paused,
            ordered=self.action_server.ordered,
            notes=self.notes(),
        )

    def notes(self) -> tuple[Note, ...]:
        """Return the warnings that hold now."""
        ledger = () if self.ledger.note is None else (self.ledger.note,)
        return (*self.driver.notes(), *self.orders.notes(), *ledger)
