"""The state of a run: the model of its fleet, and what its views show besides it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from argosy.cli.journal import Journal
from argosy.fleet_model.members import FleetAgent, FleetRobot
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.timeline import Entry
from argosy.processes.process_table import Setup
from argosy.processes.resource_usage import Meter
from argosy.processes.supervisor import Child
from schemas.wire.log_lines import RecordingStarted, RobotLeft
from schemas.wire.records import RunPhase, RunState


@dataclass
class Status:
    """A run as its views show it."""

    setup: Setup
    model: FleetModel
    journal: Journal
    meter: Meter
    children: list[Child]
    now: Callable[[], float]
    """Mission seconds since the start."""
    phase: RunPhase = "starting"
    why: str = ""
    """Why the run has failed, or why it brings its vehicles home."""
    ended: float | None = None
    """Mission time at which the run was done or had failed."""
    waiting_for: str = ""
    """The condition that the run waits for now, as text."""
    timeout_at: float | None = None
    """Mission time at which the run ends by its timeout; known once everything is up."""
    up: set[str] = field(default_factory=set)
    """Names of the processes that hold their name on the bus."""
    left: dict[str, RobotLeft] = field(default_factory=dict)
    """How each bridge left its robot, by robot."""
    killed: set[str] = field(default_factory=set)
    """Robots whose bridge did not leave in time."""
    frozen: set[str] = field(default_factory=set)
    """Robots whose state was old when the run ended."""
    recorded: str = ""
    """Outcome of the recording, as text; empty = there is none, and none was asked for."""
    restarts: Counter[str] = field(default_factory=Counter)
    """How often each process was restarted, by its name."""

    def __post_init__(self) -> None:
        """Put the changes and actions of the fleet into the journal."""
        self.model.timeline.listener = self._enter

    @property
    def agents(self) -> dict[str, FleetAgent]:
        """The agents of the mission."""
        return {name: self.model.agents[name] for name in self.setup.mission.agents}

    @property
    def robots(self) -> dict[str, FleetRobot]:
        """The robots of the mission."""
        return {name: self.model.robots[name] for name in self.setup.mission.robots}

    def flying(self) -> bool:
        """Whether any vehicle is armed, or was when it fell silent."""
        return any(robot.seen.armed for robot in self.robots.values())

    def paused(self) -> list[str]:
        """Return the robots that an operator has paused."""
        return [name for name, robot in self.robots.items() if robot.seen.paused]

    def mission_seconds(self, wall: float) -> float:
        """Convert a length of time in wall seconds, as the model has it, into mission seconds."""
        return wall * self.setup.speed

    def record(self) -> RunState:
        """Return the state of the run for the bus."""
        setup = self.setup
        return RunState(
            phase=self.phase,
            why=self.why,
            mission_time=self.now() if self.ended is None else self.ended,
            speed=setup.speed,
            report="" if setup.logs is None else str(setup.logs.resolve()),
            dead=tuple(
                f"{child.process.kind.name} {name}"
                for child in self.children
                if child.dead
                for name in child.process.subject.split()
            ),
            recording="" if setup.recording is None else str(setup.recording.path.resolve()),
        )

    def serves(self, child: Child) -> bool:
        """Whether a process is up."""
        subjects, kind = child.process.subject.split(), child.process.kind.name
        if kind == "recorder":
            return any(isinstance(line.event, RecordingStarted) for line in child.lines)
        if kind == "simulator":  # a robot without the percept `state` is up with its simulator
            reporting = self.setup.reporting
            return all(self.model.robots[robot].seen.connected for robot in subjects if robot in reporting)
        return self.model.holders(kind).issuperset(subjects)

    def _enter(self, entry: Entry) -> None:
        if entry.what in ("report", "action", "outcome"):
            self.journal.add(entry.who, entry.text, entry.level)
