"""The bridge of one robot, put together: driver, percepts, actions. It has no bus but two callbacks that publish."""

from __future__ import annotations

import asyncio
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
from commd.common.tasks import in_step, wait_at_most
from commd.process.systemd import Loop
from schemas.manifest.loader import Manifest
from schemas.manifest.rules import FUNCTOR
from schemas.mission.model import Mission
from schemas.wire.records import ActionStatus, Health, Note
from schemas.wire.terms import Atom

TICK, TICKS = 0.05, 20.0
"""Wall seconds by which a step that is due may be late, and least such ticks in a mission second."""
TICKS_ACTIVE = 5
"""Ticks between two steps, without anything due, of a robot that is active or acts: others may take or hinder it."""
TICK_IDLE = 1.0
"""Wall seconds between two steps while nothing is due soon: each step wakes the process."""
STALL, CATCH_UP = 1.0, 0.2
"""Wall seconds that a step may be late, and to read what the robot sent while this process was blocked."""
UNREADABLE = ("bad_checksums", "unreadable_packets", "samples_unreadable", "percepts_unreadable")
"""Counters that are bad input."""
log = logging.getLogger("bridged")


class Bridge:
    """One robot between its driver and its agents."""

    def __init__(
        self,
        mission: Mission,
        robot: str,
        manifest: Manifest,
        clock: Clock,
        action_log_file: Path,
        publish_percept: Publish,
        publish_status: Callable[[str, ActionStatus], None],
        *,
        boot: str,
        bus: Bus | None = None,
        simulated: bool = False,
        shared: dict[str, Any] | None = None,
        loop: Loop | None = None,
        logs: Path | None = None,
    ) -> None:
        """`shared` is what the drivers of one process share; each turn of the robot's own driver is a beat of `loop`;
        `logs` is the folder for downloaded logs (default: beside the action log).

        Raises OSError if the action log cannot be used, ValueError for what a driver cannot use.
        """
        self.name, self._source_name = robot, mission.robots[robot].source
        self._clock, loop = clock, loop or Loop.unwatched()
        self._tick = min(TICK, 1 / (TICKS * clock.speed))
        self._wake = asyncio.Event()
        """Set when something begins that steps are due for soon."""
        agents = mission.agents_of(robot)
        self.percepts = PerceptPublisher(
            manifest, agents, publish_percept, robot=robot, boot=boot, clock=clock, wake=self._wake
        )
        self.driver = CompositeDriver(
            Setup(
                name=robot,
                manifest=manifest,
                robot=mission.robots[robot],
                folder=mission.path.parent,
                clock=clock,
                on_reading=self.percepts.take,
                on_turn=loop.beat,
                bus=bus,
                state=action_log_file.parent,
                logs=logs or action_log_file.parent / "logs",
                simulated=simulated,
                shared={} if shared is None else shared,
            ),
            loop,
        )
        self.action_log = ActionLog(action_log_file)
        self.lease = Lease(agents, mission.robots[robot].lease.priority, self._lease_changed, arms=self.driver.arms)
        self.action_server = ActionServer(
            manifest,
            self.driver,
            self.percepts,
            self.action_log,
            publish_status,
            self.lease,
            robot=robot,
            boot=boot,
            clock=clock,
            wake=self._wake,
        )
        self.live = RunningManifest(manifest, self._adopt, partial(order_findings, mission, robot))
        self.orders = SafetyOrders(
            self.action_server, self.driver, self.action_log, clock, mission.robots[robot].idle_after
        )
        agent, free = self.action_log.held()  # the agent of our last run still has the robot
        if not agent and agents and self.action_log.damaged:  # it may be in flight: somebody has to answer for it
            agent, free = agents[0], True
        self.lease.restore(agent, free)
        if self.lease.answers:
            self.driver.may_be_moving()
        self._tell_holder()

    def _adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest. Raises what the drivers raise, before percepts and actions change."""
        self.driver.adopt(manifest)
        self.percepts.adopt(manifest)
        self.action_server.adopt(manifest)

    def _lease_changed(self) -> None:
        log.info("robot=%s %s", self.name, f"held by {self.lease.holder}" if self.lease.holder else "free")
        self.action_log.hold(self.lease.answers, self.lease.free)
        self._tell_holder()

    def _tell_holder(self) -> None:
        """Publish to the agents that share the robot which of them has it."""
        if len(self.percepts.sets) < 2:
            return
        holder = self.lease.holder
        name = Atom(holder if FUNCTOR.fullmatch(holder) else f"'{holder}'")
        self.percepts.show_all("holder", (name,) if holder else None)

    async def run(self) -> None:
        """Run the drivers, and let time pass, until cancelled. Raises what `CompositeDriver.run` raises."""
        passing = asyncio.create_task(self._pass_time())
        try:
            await self.driver.run()
        finally:
            passing.cancel()
            await asyncio.gather(passing, return_exceptions=True)

    async def _pass_time(self) -> None:
        """Step by the clock, independently of what the robot sends."""
        while True:
            self._wake.clear()
            pause = self._tick
            try:
                pause = self.step()
            except Exception as error:  # a defect must not end the bridge, and with it the way home
                what = {"message": f"looking at {self.name}", "exception": error}
                asyncio.get_running_loop().call_exception_handler(what)
            due = self._clock.wall() + pause
            if pause > self._tick:
                await wait_at_most(self._wake, pause)
            if pause == self._tick or self._wake.is_set():
                await asyncio.sleep(self._tick)  # also after a wake: short actions one after the other share a step
            if self._clock.wall() - due > STALL:  # what the robot sent meanwhile is read before time is judged
                await asyncio.sleep(CATCH_UP)

    def step(self) -> float:
        """Let time pass for orders, percepts and actions. Returns the wall seconds until the next step is due."""
        self.driver.step()
        self.action_log.step(self._clock.wall())
        due = self._clock.to_wall(min(self.percepts.tick(), self.action_server.step()))
        period = TICKS_ACTIVE * self._tick if self.driver.active or self.action_server.running else TICK_IDLE
        pause = max(self._tick, min(due, in_step(self._clock.wall(), period, self._tick)))
        self.percepts.next_tick = self._clock.now() + pause * self._clock.speed
        return pause

    def health(self) -> Health:
        """Figures and warnings for the bus."""
        counters = self.driver.counters() | {
            "percepts_expired": self.percepts.expired,
            "percepts_unreadable": self.percepts.unreadable,
            "actions_running": len(self.action_server.running),
            "manifest_version": self.live.version,
        }
        return Health(
            drops=self.percepts.dropped + int(counters.get("link_dropped", 0)),
            bad_input=int(sum(counters.get(name, 0) for name in UNREADABLE)),
            counters=counters,
            percepts={agent: present.digest() for agent, present in self.percepts.sets.items()},
            paused=self.action_server.paused,
            ordered=self.action_log.ordered,
            notes=self.notes(),
        )

    def notes(self) -> tuple[Note, ...]:
        """Return the warnings that hold now."""
        read = self.percepts.notes(self._source_name)
        mixed = [Note("manifest_mixed", self.live.mixed)] if self.live.mixed else []
        return (*self.driver.notes(), *read, *self.orders.notes(), *self.action_log.notes(), *mixed)
