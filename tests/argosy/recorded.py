"""A short recorded flight, to be played into the model of a run."""

from pathlib import Path

from argosy.cli.journal import Journal
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.robots import MAX_POINTS
from argosy.processes.process_table import Setup
from argosy.processes.resource_usage import Meter
from argosy.run.run_status import Status
from schemas.mission.model import load_mission
from schemas.wire import keys
from schemas.wire.mind_records import BeliefView, IntentionView, MindView
from schemas.wire.records import ActionStatus, Header, Health, Order, Perception, State
from schemas.wire.terms import Term

MISSION = Path(__file__).parents[2] / "missions" / "single_uav.yaml"
START = 1_000.0
"""Time of the model at mission second 0."""
BRIDGE = Header(source="uav1")
HOME, AWAY = (-27.604033, -48.518363), (-27.603683, -48.518052)


class Recording:
    """Plays records into the model of a run at mission times of its own."""

    def __init__(self, speed: float = 5.0) -> None:
        self.at = 0.0
        mission = load_mission(MISSION)
        journal = Journal(lambda: self.at)
        self.model = FleetModel(
            lambda: START + self.at / speed, mission=mission, track_points=MAX_POINTS, sees_runs=False
        )
        self.model.clock.look_at_run(0.0, speed, START)
        setup = Setup(mission, "tcp/127.0.0.1:7447", speed, frozenset(), Path("/nowhere"))
        self.status = Status(setup, self.model, journal, Meter(), [], lambda: self.at, phase="running")

    def percept(self, name: str, *parameters: Term) -> None:
        told = Perception(header=BRIDGE, name=name, parameters=parameters)
        self.model.percept(keys.percept("single-uav", "uav", name), told)

    def percept_gone(self, name: str) -> None:
        gone = Perception(header=BRIDGE, name=name, update="remove")
        self.model.percept(keys.percept("single-uav", "uav", name), gone)

    def action(
        self,
        number: int,
        name: str,
        state: State,
        *parameters: Term,
        reason: str = "",
        by_operator: Order | None = None,
    ) -> None:
        """Play the status of an action; `by_operator`: the order that overrides it."""
        status = ActionStatus(
            id=f"uav:1:{number}",
            state=state,
            name=name,
            parameters=parameters,
            reason=reason,
            cause="operator" if by_operator else None,
            order=by_operator,
        )
        self.model.status(keys.status("single-uav", "uav", name), status)

    def mind(self, *stack: str, done: bool = False) -> None:
        """Play a look into the mind."""
        running = (IntentionView(id=1, state="waiting", stack=stack, at="uav.asl:41"),) if stack else ()
        self.model.mind("uav", MindView(agent="uav", intentions=running, done={"mission_done": done}))

    def fail(self, *beliefs: str) -> None:
        """Play a look into the mind of an agent that has given up."""
        texts = tuple(BeliefView(text=belief) for belief in beliefs)
        self.model.mind("uav", MindView(agent="uav", failed={"mission_failed(_)": True}, beliefs=texts))

    def health(self, name: str, daemon: str, **fields: object) -> None:
        self.model.health(keys.health("single-uav", name, daemon), Health(daemon=daemon, **fields))  # type: ignore[arg-type]

    @property
    def lines(self) -> list[str]:
        """The journal as lines, without the times."""
        return [f"{entry.who}: {entry.text}" for entry in self.status.journal.entries]


def flight() -> Recording:
    """A flight to the waypoint at 40 m and back, 61 s long, with an arming that failed first."""
    recording = Recording()
    recording.percept("state", "GUIDED", True, False)
    recording.percept("home_pos", *HOME)
    recording.action(1, "arm_motors", "failed", True, reason="Arm: Need Position Estimate")
    recording.at = 2.0
    recording.action(2, "goto", "accepted", *AWAY, 40)
    recording.percept("state", "GUIDED", True, True)
    for second in range(2, 61):
        recording.at = float(second)
        share = min(1.0, (second - 2) / 20) if second < 40 else (60 - second) / 20
        recording.percept("altitude", 40 * share)
        recording.percept("global_pos", *(a + (b - a) * share for a, b in zip(HOME, AWAY, strict=True)))
        if second == 22:
            recording.action(2, "goto", "succeeded", *AWAY, 40)
        if second == 40:
            recording.percept("state", "RTL", True, True)
            recording.action(3, "return_to_launch", "running")
    recording.at = 61.0
    recording.percept("state", "RTL", True, False)
    return recording
