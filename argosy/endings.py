"""What ends a run: its mission, its operator, its time, or the loss of what it needs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from argosy.observe import SILENCE, Observer
from argosy.seen import RobotSeen
from argosy.status import Status
from argosy.supervise import Supervisor
from commd.process import EXIT_DONE, EXIT_FAILED
from schemas.durations import Duration

ROUTER_PATIENCE = 10.0
"""Wall seconds that a run goes on without its router: a restart of the router must not fail a flight."""
RESTART_PATIENCE = 45.0
"""The same where dead and hung routers are started again: as long as that may take."""
NOTHING_LEFT = 5.0
"""Wall seconds for which nobody does or intends anything until the user is told."""
DOWN: tuple[str, ...] = ("land", "rtl")
"""Orders of an operator that end the run once they are carried out, whatever the agents make of it."""
ANSWERED = 3.0
"""Wall seconds that a bridge stays after an order at least: whoever gave it hears what became of it."""


@dataclass(frozen=True)
class Ending:
    """How a run ended."""

    code: int
    text: str


class Endings:
    """Looks, a few times a second, whether something has ended the run."""

    def __init__(self, status: Status, supervisor: Supervisor, now: Callable[[], float] = time.monotonic) -> None:
        self.observer: Observer | None = None
        """Once there is a bus."""
        self._status, self._supervisor = status, supervisor
        self._mission, self._picture = status.setup.mission, status.picture
        self._idle_since: float | None = None
        self._told_idle = False
        self._now = now
        self._ordered_since: float | None = None

    def look(self) -> Ending | None:
        """Return how the run has ended, if it has."""
        if dead := self._supervisor.dead():
            return Ending(EXIT_FAILED, f"failed: {dead[0].name} {dead[0].how_it_ended()}")
        if order := self._stopped():
            return Ending(EXIT_FAILED, f"stopped by the operator: {order}")
        if why := self._failed():
            return Ending(EXIT_FAILED, f"failed: {why}")
        if self._picture.done():
            return Ending(EXIT_DONE, "done")
        if why := self._lost():
            return Ending(EXIT_FAILED, f"failed: {why}")
        self._tell_when_nothing_is_left()
        return self._late()

    def _failed(self) -> str:
        """What an agent gives up while an operator has its flying vehicle must not end the operator's order."""
        return "" if self._ordered() else self._picture.failed()

    def _ordered(self) -> list[RobotSeen]:
        return [robot for robot in self._picture.robots.values() if robot.operator]

    def _stopped(self) -> str:
        """Return the operator's order once nobody flies and it is answered: `hold` if an agent gave up upon it."""
        ordered = [robot.operator for robot in self._ordered()]
        self._ordered_since = (self._ordered_since or self._now()) if ordered else None
        if self._ordered_since is None or self._now() - self._ordered_since < ANSWERED or self._picture.flying():
            return ""
        told = [order for order in ordered if order in DOWN or self._picture.failed()]
        return ", ".join(dict.fromkeys(told))

    def _lost(self) -> str:
        """Return what the run cannot do without and has lost."""
        if self.observer is None:
            return ""
        restart = self._status.setup.restart
        since, patience = self.observer.router_lost, RESTART_PATIENCE if restart else ROUTER_PATIENCE
        if since is not None and time.monotonic() - since > patience:
            return f"the router at {self._status.setup.router} has not answered for {patience:g} s"
        if restart:  # an agent may be away for a while: dead, cut off, on its way back; what hangs is killed
            return ""
        silent = sorted(self.observer.silent)
        return f"{', '.join(silent)} has not shown its mind for {SILENCE:g} s" if silent else ""

    def _tell_when_nothing_is_left(self) -> None:
        """Say once that the run only waits for its timeout."""
        minds = self._picture.agents.values()
        idle = all(agent.cycle and not agent.intentions for agent in minds) and not self._picture.open_actions()
        until = self._status.timeout_at
        if not idle or until is None or self._ordered():
            self._idle_since = None
            return
        now, before = time.monotonic(), self._idle_since
        self._idle_since = now if before is None else before
        if before is not None and now - before - NOTHING_LEFT >= 0:
            self._idle_since = float("inf")
            left = f"the mission ends at its timeout in {until - self._status.now():.0f} s"
            self._status.journal.add("argosy", f"no agent has anything left to do; {left}", "warning")

    def _late(self) -> Ending | None:
        speed, until = self._status.setup.speed, self._status.timeout_at
        if until is None or self._status.now() <= until:
            return None
        missing = ", ".join(f"{one.agent}: {one.formula}" for one in self._mission.done)
        wall = "" if speed == 1 else f" of mission time ({self._mission.timeout / speed:.0f} s here)"
        limit = Duration(self._mission.timeout)
        return Ending(EXIT_FAILED, f"failed: not done within {limit}{wall}; expected {missing or 'ctrl-C'}")
