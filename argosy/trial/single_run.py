"""One run of a trial: a mission, its faults and its checkers in virtual time, and what became of it."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import os
import random
from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from agentd.process import allow_deep_calls
from argosy.cli.journal import Journal
from argosy.fleet_model.model import FleetModel
from argosy.processes.process_table import Place, Setup
from argosy.processes.resource_usage import Meter
from argosy.processes.simulators import linked, vehicle_of
from argosy.run.command import reporting
from argosy.run.mission_runner import MissionRunner
from argosy.run.run_status import Status
from argosy.simulate.referee import judge_run
from argosy.trial.checkers import Checkers, Violation
from argosy.trial.edges import swap_bus
from argosy.trial.event_loop import Deadlock, VirtualLoop
from argosy.trial.faults import Battery, Fault, Vehicle
from argosy.trial.network import Network, Sample, Session
from argosy.trial.process import ProcessLog, VirtualSupervisor, read_once
from argosy.trial.world import Seen, World
from bridged.simulation.turtle import command as turtle_command
from bridged.simulation.turtle.turtle import Turtle
from bridged.simulation.vehicle import process as copter_process
from commd.common.clock import Clock
from schemas.files.units import Duration
from schemas.mission.model import Mission

if TYPE_CHECKING:
    from argosy.trial.recording import TrialRecording

FIRST_ROUTER, FIRST_LINK, FIRST_VEHICLE = 7447, 8447, 1
"""Ports of the boards' routers, for their daemons and for other boards."""


class Request(msgspec.Struct, frozen=True):
    """What is to be run."""

    mission: str
    seed: int
    faults: tuple[Fault, ...] = ()
    folder: str = ""
    """Where it works and what it keeps; it exists."""
    journal: bool = False
    """Whether the journal of the run is returned."""
    until: float | None = None
    """Virtual seconds after which it is stopped."""
    record: str = ""
    """File to which its recording is written; empty: none."""


class Outcome(msgspec.Struct):
    """What became of a run."""

    seed: int
    success: bool
    why: str = ""
    """Why it is no success."""
    stopped: bool = False
    """Whether it was stopped before its end, as was wanted: it is neither a success nor a failure."""
    violations: list[Violation] = []
    faults: list[Fault] = []
    seconds: float = 0.0
    """Virtual seconds from the start of the mission to its end."""
    digest: str = ""
    """Hash over all that was published, and the end."""
    messages: int = 0
    """Records that were published."""
    flown: float | None = None
    """Metres that all vehicles have flown; None: the mission has none."""
    battery: float | None = None
    """Least share of a battery that was left, 0 to 1."""
    nearest: float | None = None
    """Least distance of two vehicles in the air, in metres."""
    journal: list[str] = []
    cpu: float = 0.0
    """CPU seconds of its process."""
    memory: int = 0
    """Bytes that its process had at most, with what it shares with its worker."""
    bad_input: bool = False
    """Whether the mission cannot be run; `why` says what is wrong with it."""

    @property
    def failed(self) -> bool:
        """Whether it is neither a success, nor was stopped before anything was wrong."""
        return bool(self.violations) or not (self.success or self.stopped)


def fly(loop: VirtualLoop, request: Request) -> Outcome:
    """Run it. Raises Findings for a mission that cannot be read."""
    network = swap_bus(loop)
    allow_deep_calls()
    os.chdir(request.folder)
    mission, vehicle_links = linked(_mission(request), _links)
    boards = mission.board_names
    routers = {board: f"tcp/127.0.0.1:{FIRST_ROUTER + number}" for number, board in enumerate(boards)}
    links = [f"tcp/127.0.0.1:{FIRST_LINK + number}" for number in range(len(boards))]
    places = {board: Place(routers[board], links[n], tuple(links[:n])) for n, board in enumerate(boards)}
    state = Path("state")
    setup = Setup(
        mission,
        routers[boards[0]],
        1.0,
        frozenset(),
        state,
        reporting(mission),
        places,
        True,
        state,
        links=vehicle_links,
    )
    clock = Clock(1.0)
    journal = Journal(clock.now, None)
    outcome = Outcome(request.seed, False, faults=list(request.faults))
    if request.journal:
        journal.shown = lambda entry: outcome.journal.append(str(entry))
    model = FleetModel(loop.time, mission=mission, track_points=2, sees_runs=False)
    status = Status(setup, model, journal, _NoMeter(), [], clock.now)
    logging.basicConfig(level=logging.INFO, handlers=[ProcessLog()], force=True)
    flight = MissionRunner(status, supervisor=VirtualSupervisor)
    world = World(
        network, routers, request.faults, lambda: status.children, fleet=mission.fleet, robots=tuple(mission.robots)
    )
    world.dice = network.dice = random.Random(f"argosy world {request.seed}")
    checkers = Checkers(mission, world, lambda robot: _served(status, robot))
    checkers.watch_minds()
    VirtualSupervisor.network, VirtualSupervisor.ready = network, staticmethod(world.board_is_up)
    VirtualSupervisor.machine = staticmethod(world.machine)
    digest = hashlib.sha256()

    def put(session: Session, sample: Sample) -> None:
        if "/trace/" in sample.key_expr or "/percept/" in sample.key_expr:  # only a recording has them
            return
        outcome.messages += 1
        if not sample.key_expr.endswith("/run"):  # it names a folder of this machine
            digest.update(f"{loop.time():.9f} {sample.key_expr} ".encode() + sample.payload.to_bytes())

    network.on_put.append(put)
    recording = _recording(request, mission, network, routers.values())
    fly_copter, drive_turtle = copter_process.simulate, turtle_command.simulate

    async def simulated_copter(vehicle: Any, *args: Any, **options: Any) -> None:
        world.vehicles[_robot_of(mission, args[0], vehicle.system)] = Seen(vehicle)
        await fly_copter(vehicle, *args, **options)

    async def simulated_turtle(turtle: Turtle, endpoint: str, prefix: str, *args: Any, **options: Any) -> None:
        world.turtles[_turtle_of(mission, prefix)] = turtle
        await drive_turtle(turtle, endpoint, prefix, *args, **options)

    copter_process.simulate = simulated_copter
    turtle_command.simulate = simulated_turtle

    async def whole() -> None:
        watching = asyncio.create_task(world.run())
        ending = await asyncio.wait_for(flight.fly(lambda: None), request.until)
        watching.cancel()
        outcome.success, outcome.why = ending.code == 0, ending.why

    try:
        loop.run_until_complete(whole())
    except TimeoutError:
        outcome.stopped, outcome.why = True, f"stopped after {request.until:g} s, as wanted"
    except Deadlock as deadlock:
        outcome.why = str(deadlock)
    if recording is not None:
        recording.close(outcome.why or "the mission is over")
    outcome.violations = checkers.found if outcome.stopped else checkers.finish()
    outcome.success = outcome.success and not outcome.violations
    if outcome.success and mission.world is not None and not (verdict := judge_run(mission, state)).good:
        outcome.success, outcome.why = False, f"the mission is done, but {verdict.summary}"
    outcome.seconds = round(flight.finished or loop.time(), 2)
    if world.vehicles:
        outcome.flown = round(sum(seen.flown for seen in world.vehicles.values()), 1)
    outcome.battery = min((seen.charge for seen in world.vehicles.values()), default=None)
    outcome.nearest = round(world.nearest, 2) if isfinite(world.nearest) else None
    outcome.digest = digest.hexdigest()[:16]
    return outcome


def _recording(request: Request, mission: Mission, network: Network, routers: Iterable[str]) -> TrialRecording | None:
    if not request.record:
        return None
    from argosy.trial.recording import TrialRecording  # needs an optional package

    return TrialRecording(Path(request.record), mission, network, routers)


def _mission(request: Request) -> Mission:
    """Return the mission with the faults of its vehicles. Raises Findings."""
    mission = read_once(request.mission)  # the trial has checked it, and all that it names, once
    robots = dict(mission.robots)
    for fault in request.faults:
        if isinstance(fault, Vehicle | Battery):
            robot = robots[fault.robot]
            assert robot.simulate is not None
            if isinstance(fault, Vehicle):
                simulate = msgspec.structs.replace(robot.simulate, faults=(*robot.simulate.faults, fault.fault))
            else:
                simulate = msgspec.structs.replace(robot.simulate, battery=Duration(60 * fault.minutes))
            robots[fault.robot] = msgspec.structs.replace(robot, simulate=simulate)
    return replace(mission, robots=robots)


def _links(robots: Iterable[str]) -> dict[str, str]:
    """Return a link for each of these vehicles, at ports that are privileged on a machine: missions name others."""
    return {name: f"udpin:127.0.0.1:{FIRST_VEHICLE + number}" for number, name in enumerate(robots)}


def _served(status: Status, robot: str) -> bool:
    """Return whether the daemon of an agent of a robot is running."""
    agents = set(status.setup.mission.agents_of(robot))
    running = (child for child in status.children if child.process.kind.name == "agentd" and child.alive)
    return any(agents.intersection(child.process.subject.split()) for child in running)


def _robot_of(mission: Mission, addresses: Sequence[Any], system: int) -> str:
    """Return the robot whose vehicle speaks at a link with a system id: several may share the link."""
    ports = {str(address).rpartition(":")[2] for address in addresses}
    speaking = (name for name, one in mission.robots.items() if one.link.rpartition(":")[2] in ports)
    return next(name for name in speaking if mission.robots[name].sysid == system)


def _turtle_of(mission: Mission, prefix: str) -> str:
    """Return the robot whose turtle has its keys below `prefix`, such as `field2/turtle1/`."""
    above = prefix.rstrip("/").rpartition("/")[0]
    turtles = (name for name, one in mission.robots.items() if vehicle_of(one) == "turtle")
    return next(name for name in turtles if mission.robots[name].prefix == above)


class _NoMeter(Meter):
    """Measures nothing: the processes of a trial are one."""

    def sample(self, pids: list[int], measured: list[int], *, flying: bool, idle: bool) -> None:
        """Do nothing."""
