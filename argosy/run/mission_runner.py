"""One run of a mission: start its processes in order, watch it, bring vehicles home and end everything."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Iterable, Mapping
from contextlib import AsyncExitStack, suppress
from itertools import pairwise
from typing import NoReturn

from msgspec.structs import replace

from argosy.cli.journal import Level
from argosy.fleet_model.observer import FleetObserver, Wanted
from argosy.processes.process_table import Process, plan
from argosy.processes.supervisor import Child, Restarts, Supervisor
from argosy.recording.run_recorder import what_became_of_it
from argosy.run.armed_warnings import age, last_line
from argosy.run.end_conditions import EndConditions, Ending
from argosy.run.recovery import Recovery, Watchdog
from argosy.run.run_status import Status
from commd.bus.bus import open_bus
from commd.bus.errors import BusClosed
from commd.common.tasks import wait_at_most
from commd.process.process import EXIT_DONE, EXIT_FAILED, on_end_signals
from schemas.manifest.rules import FUNCTOR
from schemas.mission.model import Ending as Formula
from schemas.wire import keys, log_lines
from schemas.wire.log_lines import AnyEvent, LogLine, OrderEnded, RobotLeft, RobotReleased
from schemas.wire.records import RunPhase

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that end a run; also ctrl-\\, which would leave vehicles in the air and the terminal as it is."""
STARTUP_PATIENCE = 30.0
"""Wall seconds that each step of the startup may take."""
REFRESH = 0.25
"""Wall seconds between two refreshes of the view, and between two checks of the end conditions."""
SETTLE = 2.0
"""Wall seconds after the end before idle use is measured: bridges slow the vehicle's streams only then."""
IDLE_WINDOW = 3.0
"""Wall seconds after the end over which the daemons' idle processor time is measured."""
LEAVE = 10.0
"""Wall seconds that a process has to leave: less than one, where the machine is not busy."""
LEAVE_BRIDGE = 35.0
"""The same for a bridge, which may try three orders for 10 s each on a robot that does not report its state."""
LEAVE_RECORDER = 15.0
"""Wall seconds that a recorder has to fetch what it has missed and to end its file."""
LEAVES_SOON = 3.0
"""Wall seconds after which the log says who has not left yet."""
MINDS_EVERY = 0.5
"""Wall seconds between two requests for each mind."""
POLL = 0.02
"""Wall seconds between two checks of whether a process is up."""
_LEVELS: Mapping[log_lines.Level, Level] = {
    "error": "error",
    "warning": "warning",
    "notice": "output",
    "info": "detail",
}


class StartupFailed(Exception):
    """A process did not come up in time."""


class MissionRunner:
    """One run of a mission."""

    def __init__(
        self, status: Status, bound: Callable[[], None] = lambda: None, supervisor: type[Supervisor] = Supervisor
    ) -> None:
        """`bound` is called once the routers and bridges have their ports; `supervisor` starts the processes."""
        self.status, self._bound = status, bound
        self._mission, self._journal = status.setup.mission, status.journal
        self._output = ProcessOutput(status)
        self._supervisor = supervisor(self._output.wrote, self._ended)
        status.children = self._supervisor.children
        self._end_conditions = EndConditions(status, self._supervisor)
        self._watchdog = Watchdog(status)
        self._restarts = Restarts(self._supervisor, self._journal, status.restarts, status.setup.restart)
        self._recovery = Recovery(status, self._supervisor, self._end_conditions, self._watchdog, self._restarts)
        self._wake = asyncio.Event()
        self._signals: list[signal.Signals] = []
        """Signals by which the user asked to end the run."""
        self._observer: FleetObserver | None = None
        self._bus = AsyncExitStack()
        self.finished: float | None = None
        """Mission time at which the mission ended."""
        self._marks: dict[str, float] = {}
        """Mission time at which each stretch of the run ended."""
        self._idle = False

    async def fly(self, refresh: Callable[[], None]) -> Ending:
        """Run the mission to its end and stop everything. Never raises for what a user can cause."""
        on_end_signals(self._stop_requested, *ENDS)
        helpers = [asyncio.create_task(_each(REFRESH, refresh)), asyncio.create_task(_each(1.0, self._measure))]
        startup = asyncio.create_task(self._start())
        ending = Ending(EXIT_FAILED, "failed: defect in argosy")
        try:
            ending = await self._watch(startup)
        finally:
            startup.cancel()
            await asyncio.gather(startup, return_exceptions=True)
            self._marks["mission" if "startup" in self._marks else "startup"] = self.finished = self.status.now()
            self._output.ending = True
            self._journal.add("argosy", ending.text, "good" if ending.code == EXIT_DONE else "error")
            try:
                if self._recovery.armed():
                    self._enter("bringing_home", ending.why)
                    if left := await self._bring_home():
                        ending = ending if ending.code != EXIT_DONE else Ending(EXIT_FAILED, f"failed: {left}")
                        self._journal.add("argosy", left, "error")
                self._enter("done" if ending.code == EXIT_DONE else "failed", ending.why)
                if ending.code == EXIT_DONE:
                    await self._rest()
                await self._leave()
            finally:
                await self._supervisor.close()
            for helper in helpers:
                helper.cancel()
            for defect in await asyncio.gather(*helpers, return_exceptions=True):
                if isinstance(defect, Exception):
                    self._journal.add("argosy", f"defect in argosy: {type(defect).__name__}: {defect}", "error")
            self._marks["stopping"] = self.status.now()
            refresh()
        return ending

    def phases(self) -> list[tuple[str, float]]:
        """Return the stretches of the run and how long each took in mission seconds."""
        ends = [0.0, *self._marks.values()]
        stretches = [(name, end - begin) for name, (begin, end) in zip(self._marks, pairwise(ends), strict=True)]
        return [*stretches, ("total", ends[-1])]

    async def _start(self) -> None:
        """Start routers, simulators and bridges together, then the recorder, and the agents when all of them are up."""
        status, setup = self.status, self.status.setup
        processes = plan(setup)

        async def start(kind: str) -> list[Child]:
            return [await self._begin(process) for process in processes if process.kind.name == kind]

        comm, _, bridges = [await start(kind) for kind in ("commd", "simulator", "bridged")]
        if setup.router != self._mission.router.endpoint:
            self._journal.add("argosy", f"the router of this run is at {setup.router}")
        status.waiting_for = f"the router at {setup.router}"
        bus = await self._bus.enter_async_context(
            open_bus(
                setup.router,
                fleet=self._mission.fleet,
                name="operator",
                daemon="argosy",
                wire=self._mission.wire,
                patience=STARTUP_PATIENCE,
            )
        )
        wanted = Wanted(MINDS_EVERY, beliefs_about=_causes(self._mission.failed), whole_fleet=False)
        observer = self._observer = FleetObserver(bus, status.model, self._mission.fleet, wanted)
        await self._until(comm)
        recorders = await start("recorder")
        await self._until(bridges)
        self._bound()
        await self._recorded(recorders)
        agents = await start("agentd")
        await self._until(agents)
        observer.start()
        await observer.look_at_percepts()
        self._marks["startup"] = status.now()
        status.timeout_at = status.now() + self._mission.timeout
        self._enter("running")
        await self._heartbeats()
        status.waiting_for = ""

    async def _begin(self, process: Process) -> Child:
        try:
            child = await self._supervisor.start(process)
        except OSError as error:
            raise StartupFailed(f"{process.name} cannot be started: {error.strerror}") from None
        self._journal.add(process.name, f"started, pid {child.pid}")
        return child

    async def _until(self, children: list[Child]) -> None:
        """Wait until processes are up."""
        for child in children:
            name = child.name
            await self._wait_for(name, lambda child=child: self.status.serves(child))  # type: ignore[misc]
            self._journal.add(name, "up", "good")

    async def _recorded(self, recorders: list[Child]) -> None:
        """Wait until a recorder is up, so that agents are recorded from their start."""
        recording = self.status.setup.recording
        for child in recorders:
            with suppress(StartupFailed):
                await self._wait_for(child.name, lambda child=child: self.status.serves(child) or not child.alive)  # type: ignore[misc]
            if self.status.serves(child):
                self._journal.add(child.name, "up", "good")
            elif recording is not None and recording.asked_for:
                raise StartupFailed(f"{child.name} {child.how_it_ended()}")
            elif child.alive:
                self._journal.add(child.name, f"has not begun within {STARTUP_PATIENCE:g} s", "warning")

    async def _heartbeats(self) -> None:
        for name, robot in self._mission.robots.items():
            if self._mission.agents_of(name) and name in self.status.setup.reporting:
                what = f"a heartbeat of the vehicle of {name} on {robot.link or robot.prefix}"
                await self._wait_for(what, lambda name=name: self.status.robots[name].seen.connected)  # type: ignore[misc]

    async def _wait_for(self, what: str, there: Callable[[], bool]) -> None:
        self.status.waiting_for = what
        for _ in range(round(STARTUP_PATIENCE / POLL)):
            if there():
                return
            await asyncio.sleep(POLL)
        raise StartupFailed(f"timed out after {STARTUP_PATIENCE:g} s: waited for {what}")

    async def _watch(self, startup: asyncio.Task[None]) -> Ending:
        """Wait until the run ends."""
        while True:
            self._wake.clear()
            if self._signals:
                return Ending(128 + self._signals[-1], f"stopped by {self._interrupted()}")
            if startup.done() and (error := startup.exception()) is not None and not self._supervisor.dead():
                if isinstance(error, StartupFailed | BusClosed):
                    return Ending(EXIT_FAILED, f"failed at the start: {error}")
                raise error
            if ending := self._end_conditions.look():
                if not (ending.graced and self._recovery.armed()):
                    return ending
                if ending := await self._recovery.outlasts_grace(ending, self._interrupted):
                    return ending
            if self.status.setup.restart:
                self._watchdog.look()
                self._restarts.report_restarted(self.status.serves)
            await wait_at_most(self._wake, REFRESH)

    def _interrupted(self) -> str:
        """Return the signal by which the user ended the run, as text; empty if there was none."""
        if not self._signals:
            return ""
        return "ctrl-C" if self._signals[-1] == signal.SIGINT else self._signals[-1].name

    async def _rest(self) -> None:
        """Leave the daemons in peace for a moment to measure what they use when idle."""
        if self.status.flying() or self.status.model.actions.open():
            return
        self.status.waiting_for = "idle use to be measured"
        if self._observer is not None:
            self._observer.asks_minds = False
        if await self._undisturbed(SETTLE):
            self._sample()
            self._idle = True
            await self._undisturbed(IDLE_WINDOW)
            self._sample()
            self._idle = False
        self._marks["measuring"] = self.status.now()

    async def _undisturbed(self, seconds: float) -> bool:
        """Wait `seconds`, unless the user or a process ends. Returns whether the time passed."""
        self._wake.clear()
        return not await wait_at_most(self._wake, seconds)

    async def _bring_home(self) -> str:
        """Wait until no vehicle is armed; the agents leave meanwhile, so that only bridges command vehicles.

        Returns which vehicles were left armed and are not a pilot's, and why; empty if there is none.
        """
        for bridge in self._supervisor.of_kind("bridged"):
            for name in bridge.process.subject.split():
                self._report_armed(name, bridge)
        leaving = asyncio.create_task(self._stop(self._supervisor.of_kind("agentd"), LEAVE))
        left = await self._recovery.bring_home(self._interrupted)
        await leaving
        return left

    async def _leave(self) -> None:
        """Stop everything in order: a bridge may need its simulator, and both are watched through commd."""
        await self._restarts.close()
        self.status.waiting_for = ""
        for robot in self.status.robots.values():
            if old := age(self.status, robot):
                self.status.frozen.add(robot.name)
                self._journal.add(robot.name, f"its last known state is {old:.0f} s old", "warning")
        await self._stop(self._supervisor.of_kind("agentd"), LEAVE)
        bridges = self._supervisor.of_kind("bridged")
        for bridge in bridges:
            if all(map(self._recovery.simulator_is_dead, bridge.process.subject.split())):
                bridge.kill()
        await self._stop(bridges, LEAVE if any(one.seen.armed for one in self._recovery.armed()) else LEAVE_BRIDGE)
        if self._observer is not None:
            await self._observer.stop()
        await self._stop(self._supervisor.of_kind("recorder"), LEAVE_RECORDER)
        await self._bus.aclose()
        await self._stop(self._supervisor.of_kind("simulator"), LEAVE)
        for router in reversed(self._supervisor.of_kind("commd")):  # one by one: each reports its leave to the others
            await self._stop([router], LEAVE)

    def _report_armed(self, robot: str, bridge: Child) -> None:
        member = self.status.robots[robot]
        seen = member.seen
        if not seen.armed:
            return
        state = "was armed when it was last heard" if seen.lost or age(self.status, member) else "is armed"
        if self._recovery.simulator_is_dead(robot):
            self._journal.add(robot, "was armed until its simulator died", "warning")
        elif seen.coming_home and (bridge.alive or bridge.replaced):
            self._journal.add(robot, f"comes home in {seen.mode}: its bridge stays with it", "info")
        elif bridge.alive or bridge.replaced:
            order = self._mission.robots[robot].on_shutdown
            self._journal.add(robot, f"{state}: its bridge is to order {order} (on_shutdown)", "warning")
        else:
            self._journal.add(
                robot, f"{state} and its bridge reports nothing: {last_line(self.status, robot)}", "error"
            )

    async def _stop(self, children: list[Child], patience: float) -> None:
        slow = asyncio.get_running_loop().call_later(LEAVES_SOON, self._report_slow, children, patience)
        try:
            killed = await self._supervisor.leave(children, patience, self._recovery.hurry)
        finally:
            slow.cancel()
        for late in killed:
            within = "immediately, as you ordered," if self._recovery.hurry.is_set() else f"within {patience:g} s"
            self._journal.add(late.name, f"did not leave {within} and was killed", "warning")
            if late.process.kind.name == "bridged":
                self.status.killed.update(late.process.subject.split())

    def _report_slow(self, children: list[Child], patience: float) -> None:
        robots = self.status.robots
        for child in (child for child in children if child.alive):
            served = [robots[name] for name in child.process.subject.split() if name in robots]
            unheard = child.process.kind.name == "bridged" and any(map(self.status.model.unheard, served))
            hangs = ", and publishes nothing: a driver of its robot may not return" if unheard else ""
            text = f"has not left after {LEAVES_SOON:g} s{hangs}; it is killed after {patience:g} s"
            self._journal.add(child.name, text, "warning")

    def _enter(self, phase: RunPhase, why: str = "") -> None:
        """Go on to another phase of the run, and publish it."""
        status = self.status
        status.phase, status.why = phase, why
        if phase in ("done", "failed"):
            status.ended = status.now() if status.ended is None else status.ended
        self._publish()

    def _publish(self) -> None:
        self.status.model.clock.look_at_run(self.status.now(), self.status.setup.speed, self.status.model.now())
        if self._observer is not None:
            bus = self._observer.bus
            bus.put(keys.run(bus.fleet, bus.name), replace(self.status.record(), header=bus.header("run")))

    def _measure(self) -> None:
        self._sample()
        self._publish()

    def _sample(self) -> None:
        children = [child for child in self.status.children if child.alive]
        measured = [child.pid for child in children if child.process.kind.measured]
        flying = self.status.flying() and self.finished is None
        self.status.meter.sample([child.pid for child in children], measured, flying=flying, idle=self._idle)

    def _stop_requested(self, number: signal.Signals) -> None:
        """End the mission; on a second signal, or when no vehicle flies, leave immediately."""
        self._signals.append(number)
        self._wake.set()
        armed = self._recovery.armed()
        if len(self._signals) == 1 and (self.finished is None or armed):
            if self.finished is not None:
                be = "is" if all(robot.seen.armed for robot in armed) else "may be"
                names = ", ".join(robot.name for robot in armed)
                text = f"{names} {be} armed and is brought home: ctrl-C again leaves immediately"
                self._journal.add("argosy", text, "warning")
            return
        self._recovery.hurry.set()
        self._journal.add("argosy", "hurrying", "warning")

    def _ended(self, child: Child) -> None:
        if child.dead:
            self._restarts.died(child)
            for name in child.process.subject.split():
                if child.process.kind.name == "agentd":
                    self.status.model.agents[name].forget()
                elif child.process.kind.name == "bridged":
                    self.status.model.bridge_died(name)
        if child.dead:  # and is not restarted
            without = "" if child.process.kind.needed else "; the run goes on and is no longer recorded"
            self._journal.add(child.name, child.how_it_ended() + without, "error")
        if child.process.kind.name == "recorder":
            self.status.recorded = what_became_of_it(child.lines, child.how_it_ended())
        self._wake.set()


async def _each(seconds: float, act: Callable[[], None]) -> NoReturn:
    """Act again and again, after `seconds` of wall time each."""
    while True:
        act()
        await asyncio.sleep(seconds)


def _causes(failed: Iterable[Formula]) -> dict[str, str]:
    """Return the functor of the beliefs by which each agent of some `failed` formulas says why; empty: any beliefs."""
    causes: dict[str, str] = {}
    for one in failed:
        plain = FUNCTOR.fullmatch(one.functor) and causes.get(one.agent, one.functor) == one.functor
        causes[one.agent] = one.functor if plain else ""
    return causes


class ProcessOutput:
    """Takes the lines of processes into the journal, and their events into the model."""

    def __init__(self, status: Status) -> None:
        self.ending = False
        """Whether the run is over: then lines of level `info` are shown too."""
        self._model, self._journal, self._left = status.model, status.journal, status.left

    def wrote(self, child: Child, line: LogLine) -> None:
        """Take a line of a process."""
        kind, subjects = child.process.kind.name, child.process.subject.split()
        if kind == "agentd" and line.agent in subjects:
            self._model.agents[line.agent].prints.append(line.text)
            self._journal.add(line.agent, line.text, "print")
        elif kind == "agentd" and line.agent:  # an agent that was created at run time
            self._journal.add(child.name, f"[{line.agent}] {line.text}", "output")
        elif kind == "bridged" and getattr(line.event, "robot", None) in subjects:
            self._reported(line.event)
        else:
            level = _LEVELS[line.level]
            self._journal.add(child.name, line.text, "output" if level == "detail" and self.ending else level)

    def _reported(self, event: AnyEvent | None) -> None:
        """Take an event of a bridge about its robot: no action status reports it when no action ran."""
        match event:
            case RobotLeft(robot=robot, state=state, text=text):
                self._left[robot] = event
                levels: dict[str, Level] = {"ordered": "good", "disarmed": "info", "piloted": "warning"}
                self._journal.add(robot, f"its bridge left it: {text}", levels.get(state, "error"))
            case OrderEnded(robot=robot, order=order, confirmed=True, reason=reason):
                self._model.ordered(robot, order)
                self._journal.add(robot, f"{order} confirmed: {reason or 'the vehicle does it'}", "good")
            case OrderEnded(robot=robot, order=order, reason=reason):
                self._model.ordered(robot, order)
                self._journal.add(robot, f"{order} NOT confirmed: {reason}", "error")
            case RobotReleased(robot=robot):
                self._model.released(robot)
