"""How a run stands: what the views show besides the picture of the fleet."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from argosy.cli.journal import Journal
from argosy.fleet_model.picture import Picture
from argosy.processes.process_table import Setup
from argosy.processes.resource_usage import Meter
from argosy.processes.supervisor import Child
from schemas.wire.log_lines import RecordingStarted, RobotLeft
from schemas.wire.records import RunPhase, RunState


@dataclass
class Status:
    """A run as its views see it."""

    setup: Setup
    picture: Picture
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
    """What the run waits for now, in words."""
    timeout_at: float | None = None
    """Mission time at which the run ends by its timeout; known once everything is up."""
    up: set[str] = field(default_factory=set)
    """Names of the processes that have shown themselves on the bus."""
    left: dict[str, RobotLeft] = field(default_factory=dict)
    """How each bridge left its robot."""
    killed: set[str] = field(default_factory=set)
    """Robots whose bridge did not leave in time."""
    frozen: set[str] = field(default_factory=set)
    """Robots of which nothing new was heard any more when the run ended."""

    recorded: str = ""
    """What became of the recording, in words; empty = there is none and nobody wanted one."""

    restarts: Counter[str] = field(default_factory=Counter)
    """How often each process was started again, by its name."""

    def record(self) -> RunState:
        """Return how far the run has come, for the bus."""
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
        """Whether a process has come so far that it does its work."""
        subjects, kind = child.process.subject.split(), child.process.kind.name
        if kind == "recorder":
            return any(isinstance(line.event, RecordingStarted) for line in child.lines)
        if kind == "simulator":  # a robot that is never told to be connected is there when its simulator runs
            telling = self.setup.telling
            return all(self.picture.robots[robot].connected for robot in subjects if robot in telling)
        return all(self.picture.is_alive(subject, kind) for subject in subjects)
