"""The members of a fleet as an observer sees them: agents, robots, boards. What is not known is None, never made up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from argosy.fleet_model.fleet_status import Row, Standing
from argosy.fleet_model.robots import RobotSeen
from argosy.fleet_model.track import Track
from schemas.liveness import STALE_AFTER
from schemas.wire.mind_records import MindView
from schemas.wire.records import Mailboxes, Note

TRACK = 2_000
"""Points of a robot's track that are kept."""


@dataclass
class Member:
    """Anybody with a daemon of its own."""

    name: str
    daemon: str
    board: str = ""
    """Empty: not known."""
    row: Row | None = None
    """How its daemon stands; None = it was never there."""
    since: float | None = None
    """Unix seconds at which it came, or went if it is gone."""
    ended: bool = False
    """It has left when its run was over or was being ended: that is no loss."""
    told: float | None = None
    """Unix seconds at which its daemon last told how it is."""

    @property
    def there(self) -> bool:
        """Whether its daemon holds its name on the bus."""
        return self.row is not None and self.row.standing not in ("missing", "unclaimed")

    @property
    def standing(self) -> Standing:
        """How its daemon stands (docs/guides/monitoring.md)."""
        return "missing" if self.row is None else self.row.standing

    @property
    def well(self) -> bool:
        """Whether it is there and tells how it is."""
        return self.row is not None and self.row.well

    @property
    def notes(self) -> tuple[Note, ...]:
        """Warnings that hold now: of its standing, and its own."""
        return () if self.row is None or self.ended else self.row.notes

    @property
    def lag(self) -> float:
        """Seconds by which it is behind; 0 if it tells nothing."""
        return 0.0 if self.row is None or self.row.now is None else self.row.now.lag

    @property
    def drops(self) -> int:
        """What its queues have dropped so far."""
        return 0 if self.row is None or self.row.now is None else self.row.now.drops


@dataclass
class TeamAgent(Member):
    """An agent and what it has shown of its mind last."""

    daemon: str = "agentd"
    robot: str = ""
    """The robot that it acts with; empty: none, or not known yet."""
    mind: MindView | None = None
    detail: MindView | None = None
    """The last view that was asked for with everything in it; see `detailed`."""
    heard: float | None = None
    """Unix seconds at which it last showed its mind."""
    detailed: float | None = None
    """Unix seconds of `detail`."""
    silent: float | None = None
    """Unix seconds since when its mind answers no question although the router does; None = it answers."""
    why_silent: str = ""
    """What came instead of an answer."""

    def forget(self) -> None:
        """Its mind is another one now, that has not been seen yet."""
        self.mind = self.detail = self.heard = self.detailed = self.silent = None
        self.why_silent = ""

    def age(self, now: float) -> float | None:
        """Return for how many seconds its mind has not been heard."""
        return None if self.heard is None else max(0.0, now - self.heard)


@dataclass
class TeamRobot(Member):
    """A robot, its bridge, and what the agents of the robot perceive."""

    daemon: str = "bridged"
    agents: tuple[str, ...] = ()
    """Who acts with it, as its bridge tells."""
    seen: RobotSeen = field(default_factory=lambda: RobotSeen(""))

    @classmethod
    def named(cls, name: str, board: str = "") -> TeamRobot:
        """Return a robot of which nothing is known."""
        return cls(name, board=board, seen=RobotSeen(name, track=Track(most=TRACK)))

    def age(self, now: float) -> float | None:
        """Return how old what is known of it is, in seconds: its bridge tells changes, and that it is there itself."""
        if not self.seen.heard:
            return None
        last = self.seen.heard if self.seen.lost or self.told is None else max(self.seen.heard, self.told)
        return max(0.0, now - last)

    def stale(self, now: float) -> bool:
        """Whether what is known of it is old, or nothing is known."""
        age = self.age(now)
        return age is None or self.seen.lost or age > STALE_AFTER


@dataclass
class TeamBoard(Member):
    """A board's `commd` and the mail that waits there."""

    daemon: str = "commd"
    mailboxes: Mailboxes | None = None
    heard: float | None = None
    """Unix seconds of `mailboxes`."""
    problem: str = ""
    """Why its mailboxes are not known now; empty if they are."""

    def waiting(self, names: Sequence[str] | None = None) -> int:
        """Return how many messages wait there, for these receivers or for all."""
        queues = () if self.mailboxes is None else self.mailboxes.queues
        return sum(queue.messages for queue in queues if names is None or queue.receiver in names)
