"""What ends a run: its mission, its operator, its time, or the loss of what it needs."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from argosy.fleet_model.robots import RobotSeen
from argosy.fleet_model.snapshot import Observer
from argosy.processes.supervisor import Supervisor
from argosy.run.run_status import Status
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.units import Duration
from schemas.liveness import SILENT_AFTER
from schemas.mission.model import NO_STEPS

ROUTER_PATIENCE = 10.0
"""Wall seconds that a run goes on without its router: a restart of the router must not fail a flight."""
RESTART_PATIENCE = 45.0
"""The same where dead and hung routers are started again: as long as that may take."""
NOTHING_LEFT = 5.0
"""Wall seconds for which nobody does or intends anything until that is told, or ends the run."""
DOWN: tuple[str, ...] = ("land", "rtl")
"""Orders of an operator that end the run once they are carried out, whatever the agents make of it."""
ANSWERED = 3.0
"""Wall seconds that a bridge stays after an order at least: whoever gave it hears what became of it."""


@dataclass(frozen=True)
class Ending:
    """How a run ended."""

    code: int
    text: str
    graced: bool = field(default=False, compare=False)
    """Whether programs may bring armed vehicles home first, and the reason may pass meanwhile."""

    @property
    def why(self) -> str:
        """What it ended for, without the word that says how; empty if it is done."""
        return "" if self.code == EXIT_DONE else self.text.removeprefix("failed: ")


class EndConditions:
    """Looks, a few times a second, whether something has ended the run."""

    def __init__(self, status: Status, supervisor: Supervisor, now: Callable[[], float] = time.monotonic) -> None:
        self.observer: Observer | None = None
        """Once there is a bus."""
        self._status, self._supervisor = status, supervisor
        self._mission, self._picture = status.setup.mission, status.picture
        self._idle_since: float | None = None
        """Since when no agent has anything left to do, in wall seconds."""
        self._told_idle = False
        self._death: Ending | None = None
        """The first death of a needed process: what is started again to bring vehicles home does not undo it."""
        self._now = now
        self._ordered_since: float | None = None
        self._looked_at = status.now()

    def look(self) -> Ending | None:
        """Return how the run has ended, if it has."""
        self._wait_for_paused()
        if self._death is None and (dead := self._supervisor.dead()):
            self._death = Ending(EXIT_FAILED, f"failed: {dead[0].name} {dead[0].how_it_ended()}", graced=True)
        if self._death is not None:
            return self._death
        if why := self._picture.not_commanded():
            return Ending(EXIT_FAILED, f"failed at the start: {why}")
        if order := self._stopped():
            return Ending(EXIT_FAILED, f"stopped by the operator: {order}")
        if why := self._failed():
            return Ending(EXIT_FAILED, f"failed: {why}", graced=True)
        if self._picture.done() and not (self._picture.paused() and self._picture.flying()):
            return Ending(EXIT_DONE, "done")
        if why := self._lost():
            return Ending(EXIT_FAILED, f"failed: {why}", graced=True)
        return self._nothing_left() or self._late()

    def _wait_for_paused(self) -> None:
        """Put off the timeout for as long as an operator has paused a robot."""
        now = self._status.now()
        if self._status.timeout_at is not None and self._picture.paused():
            self._status.timeout_at += now - self._looked_at
        self._looked_at = now

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
        return f"{', '.join(silent)} has not shown its mind for {SILENT_AFTER:g} s" if silent else ""

    def _nothing_left(self) -> Ending | None:
        """End the run when no agent has anything left to do and `on_idle` has brought home what flew.

        Without that only the timeout ends it, which is said once: an agent on the ground may wait for what comes.
        """
        until = self._status.timeout_at
        if until is None or self._ordered() or self._picture.paused() or not self._idle():
            self._idle_since, self._told_idle = None, False
            return None
        now = self._now()
        self._idle_since = now if self._idle_since is None else self._idle_since
        if now - self._idle_since < NOTHING_LEFT:
            return None
        if home := self._brought_home():
            why = f"{', '.join(home)} was in the air with nobody in charge and was brought home (on_idle)"
            over = Ending(EXIT_FAILED, f"failed: {why}; no agent has anything left to do")
            return None if self._picture.flying() else over
        if not self._told_idle:
            self._told_idle = True
            left = f"the mission ends at its timeout in {until - self._status.now():.0f} s"
            self._status.journal.add("argosy", f"no agent has anything left to do; {left}", "warning")
        return None

    def _idle(self) -> bool:
        """Whether all agents are heard, and idle."""
        cut_off = self.observer is not None and (self.observer.silent or self.observer.router_lost is not None)
        return not cut_off and self._picture.idle()

    def _brought_home(self) -> list[str]:
        """Return the robots that their bridges have brought home since no agent was in charge of them."""
        robots = self._mission.robots
        unattended = [robot.name for robot in self._picture.robots.values() if robot.unattended]
        return [name for name in unattended if robots[name].on_idle != NO_STEPS]

    def _late(self) -> Ending | None:
        speed, until = self._status.setup.speed, self._status.timeout_at
        if until is None or self._status.now() <= until:
            return None
        missing = ", ".join(f"{one.agent}: {one.formula}" for one in self._mission.done)
        wall = "" if speed == 1 else f" of mission time ({self._mission.timeout / speed:.0f} s here)"
        limit = Duration(self._mission.timeout)
        return Ending(EXIT_FAILED, f"failed: not done within {limit}{wall}; expected {missing or 'ctrl-C'}")
