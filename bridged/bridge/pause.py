"""The operator's pause of one robot: its percept, its record on disk, and time without pauses for deadlines."""

from __future__ import annotations

import logging
from collections.abc import Callable

from bridged.bridge.action_log import ActionLog
from bridged.bridge.percepts import PerceptPublisher
from schemas.wire.terms import Atom

PERCEPT = "paused"
log = logging.getLogger("actions")


class Pause:
    """A pause of the robot; one that a former run of the bridge has begun continues."""

    def __init__(self, action_log: ActionLog, percepts: PerceptPublisher, robot: str, now: Callable[[], float]) -> None:
        self._action_log, self._percepts, self._robot, self._now = action_log, percepts, robot, now
        self._since: float | None = None
        self._over = 0.0
        """Mission seconds of the pauses that are over."""
        if action_log.paused:
            self._since = now()
            self._tell()

    @property
    def lasts(self) -> bool:
        """Whether the robot is paused now."""
        return self._since is not None

    @property
    def elapsed(self) -> float:
        """Mission seconds so far without those of pauses."""
        return (self._now() if self._since is None else self._since) - self._over

    def begin(self) -> None:
        """Begin a pause, unless one lasts."""
        if self._since is None:
            self._since = self._now()
            self._tell()
            self._keep()

    def end(self) -> None:
        """End the pause if one lasts."""
        if self._since is not None:
            self._over += self._now() - self._since
            self._since = None
            self._tell()
            self._keep()

    def _tell(self) -> None:
        """Let every agent of the robot perceive `paused(operator)` while it lasts."""
        for agent in self._percepts.sets:
            if self.lasts:
                self._percepts.show(agent, PERCEPT, (Atom("operator"),))
            else:
                self._percepts.withdraw(agent, PERCEPT)

    def _keep(self) -> None:
        said = "paused by the operator" if self.lasts else "not paused any longer"
        log.info("robot=%s %s", self._robot, said)
        try:
            self._action_log.pause(self.lasts)
        except OSError as error:
            log.error("robot=%s `%s` cannot be kept on disk: %s", self._robot, said, error.strerror)
