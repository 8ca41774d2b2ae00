"""An action that runs: what it is, until when, and who wants to hear of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from bridged.bridge.feedback import Progress
from bridged.drivers.api import Execution
from schemas.manifest.loader import ActionEntry, Argument
from schemas.wire.records import Action, ActionStatus

MAX_FOLLOWERS = 16
"""Queries that may wait for the end of one action; the newest are kept."""

Follower = Callable[[ActionStatus | None], None]
"""Called with each status of an action from now on; the last one is final, or None if a newer asker took the place."""


@dataclass(eq=False)
class RunningAction:
    """An action that runs."""

    action: Action
    entry: ActionEntry
    execution: Execution
    deadline_at: float
    deadline: float
    status: ActionStatus
    told_at: float
    progress: Progress
    arguments: dict[str, Argument]
    held: bool = False
    """It is to be begun, or begun again, when the operator continues."""
    noted: bool = False
    """Its beginning stands in the log."""
    cause: str = ""
    """What hindered it when it was told last."""
    logged_cause: str = ""
    followers: list[tuple[str, Follower]] = field(default_factory=list)
    """Who asked, and what hears of it; one for each asker that has a name."""

    def join(self, asker: str, follower: Follower) -> None:
        """Add a follower. It takes the place of the asker's former one: who asks again has given that query up."""
        follower(self.status)
        former = [one for one in self.followers if asker and one[0] == asker]
        for one in former or self.followers[: max(0, len(self.followers) - MAX_FOLLOWERS + 1)]:
            self.followers.remove(one)
            one[1](None)
        self.followers.append((asker, follower))

    def tell(self, status: ActionStatus) -> None:
        """Tell all who wait."""
        self.status = status
        for _, follower in self.followers:
            follower(status)
