"""A fleet on paper: records of two agents and their robots, played into a model at times of their own."""

from __future__ import annotations

from argosy.fleet_model.model import FleetModel
from schemas.mission.model import Mission
from schemas.wire import keys
from schemas.wire.mind_records import ActivityEvent, BeliefView, IntentionView, MindActivity, MindView, WaitView
from schemas.wire.records import ActionStatus, Header, Health, Mailboxes, Perception, Queue, RunPhase, RunState, State
from schemas.wire.terms import Term

FLEET = "sar"
HOME = (-27.604033, -48.518363)


class Fleet:
    """Plays records into a model."""

    def __init__(self, mission: Mission | None = None) -> None:
        self.at = 1_000_000.0
        self.model = FleetModel(lambda: self.at, fleet=FLEET, mission=mission)

    def comes(self, name: str, daemon: str, boot: str = "b1") -> Fleet:
        self.model.token(keys.alive(FLEET, name, daemon, boot), alive=True)
        return self.told(name, daemon)

    def goes(self, name: str, daemon: str, boot: str = "b1") -> Fleet:
        self.model.token(keys.alive(FLEET, name, daemon, boot), alive=False)
        self.model.tick()
        return self

    def told(self, name: str, daemon: str, **fields: object) -> Fleet:
        """A daemon tells how it is."""
        self.model.health(keys.health(FLEET, name, daemon), Health(daemon=daemon, **fields))  # type: ignore[arg-type]
        self.model.tick()
        return self

    def percept(self, agent: str, name: str, *parameters: Term, **fields: object) -> Fleet:
        told = Perception(header=Header(source="bridge"), name=name, parameters=parameters, **fields)  # type: ignore[arg-type]
        self.model.percept(keys.percept(FLEET, agent, name), told)
        return self

    def action(self, agent: str, number: int, name: str, state: State, *parameters: Term, **fields: object) -> Fleet:
        told = ActionStatus(id=f"{agent}:1:{number}", state=state, name=name, parameters=parameters, **fields)  # type: ignore[arg-type]
        self.model.status(keys.status(FLEET, agent, name), told)
        return self

    def mind(self, agent: str, *stack: str, **fields: object) -> Fleet:
        """An agent shows its mind."""
        running = (
            IntentionView(
                id=1, state="waiting", waits_for=WaitView(kind="action", name="goto"), stack=stack, at="uav.asl:41"
            ),
        )
        beliefs = (BeliefView(text="height(20)", sources=("self",), since=3.0),)
        view = MindView(agent=agent, intentions=running if stack else (), beliefs=beliefs, **fields)  # type: ignore[arg-type]
        self.model.mind(agent, view)
        return self

    def activity(self, agent: str, *events: ActivityEvent, **fields: object) -> Fleet:
        """An agent tells what it did."""
        told = MindActivity(agent=agent, events=events, **fields)  # type: ignore[arg-type]
        self.model.activity(keys.trace(FLEET, agent, "activity"), told)
        return self

    def runs(self, phase: RunPhase, seconds: float, **fields: object) -> Fleet:
        """`argosy run` tells how far the run has come."""
        told = RunState(phase=phase, mission_time=seconds, **fields)  # type: ignore[arg-type]
        self.model.run_published(keys.run(FLEET, "operator"), told)
        return self

    def mail(self, board: str, *queues: Queue) -> Fleet:
        self.model.mailboxes(keys.mailboxes(FLEET, board), Mailboxes(board=board, queues=queues))
        return self

    def waits(self, seconds: float) -> Fleet:
        """Time passes."""
        self.at += seconds
        self.model.tick()
        return self


def rescue() -> Fleet:
    """A scout that flies, with its bridge and board."""
    fleet = Fleet().comes("pi1", "commd").comes("uav1", "bridged").comes("scout", "agentd")
    fleet.told("uav1", "bridged", percepts={"scout": "b:1:0"})
    fleet.percept("scout", "state", "GUIDED", True, True).percept("scout", "home_pos", *HOME)
    return fleet.percept("scout", "global_pos", *HOME).percept("scout", "altitude", 20.0)
