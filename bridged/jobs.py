"""An action that runs: what it is, until when, and who wants to hear of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from bridged.drivers.robot import Execution
from bridged.progress import Progress
from schemas.manifest import ActionEntry, Argument
from schemas.records import Action, ActionStatus

MAX_FOLLOWERS = 16
"""Queries that may wait for the end of one action; the newest: an asker whose link flaps has given up the others."""

Follower = Callable[[ActionStatus | None], None]
"""Called with each status of an action from now on; the last one is final, or None if a newer asker took the place."""


@dataclass(eq=False)
class Job:
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
    followers: list[Follower] = field(default_factory=list)
    noted: bool = False
    """Its beginning stands in the log."""

    def join(self, follower: Follower) -> None:
        """Let one more hear how it is, and what becomes of it."""
        follower(self.status)
        if len(self.followers) >= MAX_FOLLOWERS:
            self.followers.pop(0)(None)
        self.followers.append(follower)

    def tell(self, status: ActionStatus) -> None:
        """Tell all who wait."""
        self.status = status
        for follower in self.followers:
            follower(status)
