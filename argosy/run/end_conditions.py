"""The conditions that end a run: mission, operator, timeout, or the loss of a needed process."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from argosy.fleet_model.members import FleetRobot
from argosy.processes.supervisor import Supervisor
from argosy.run.run_status import Status
from commd.process.process import EXIT_DONE, EXIT_FAILED
from schemas.files.units import Duration
from schemas.humanize import printable
from schemas.liveness import SILENT_AFTER
from schemas.mission.model import NO_STEPS

ROUTER_PATIENCE = 10.0
"""Wall seconds that a run goes on without its router: a restart of the router must not fail a flight."""
RESTART_PATIENCE = 45.0
"""The same where dead and hung routers are started again: as long as that may take."""
NOTHING_LEFT = 5.0
"""Wall seconds without any intention or action until that is reported, or ends the run."""
DOWN: tuple[str, ...] = ("land", "rtl")
"""Orders of an operator that end the run once they are carried out, whatever the agents do."""
ANSWERED = 3.0
"""Wall seconds that a bridge stays at least after an order, so that the operator gets its outcome."""


@dataclass(frozen=True)
class Ending:
    """How a run ended."""

    code: int
    text: str
    graced: bool = field(default=False, compare=False)
    """Whether programs may bring armed vehicles home first; the reason may pass meanwhile."""

    @property
    def why(self) -> str:
        """The reason without `failed:`; empty if it is done."""
        return "" if self.code == EXIT_DONE else self.text.removeprefix("failed: ")


class EndConditions:
    """Judges, a few times a second, whether something has ended the run."""

    def __init__(self, status: Status, supervisor: Supervisor, now: Callable[[], float] = time.monotonic) -> None:
        self._status, self._supervisor = status, supervisor
        self._mission, self._model = status.setup.mission, status.model
        self._idle_since: float | None = None
        """Wall time since when no agent has anything left to do."""
        self._idle_reported = False
        self._withheld = False
        """Whether an agent has given up and only an operator's order keeps the run, which was reported."""
        self._death: Ending | None = None
        """The first death of a needed process; a restart to bring vehicles home does not undo it."""
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
        if why := self._not_commanded():
            return Ending(EXIT_FAILED, f"failed at the start: {why}")
        if order := self._stopped():
            return Ending(EXIT_FAILED, f"stopped by the operator: {order}")
        why = self._failed()
        if why and not self._ordered():
            return Ending(EXIT_FAILED, f"failed: {why}", graced=True)
        if why and not self._withheld:  # an agent that gives up does not end an operator's order
            self._status.journal.add("argosy", f"{why}; the run goes on under an operator's order", "warning")
        self._withheld = bool(why)
        if self._done() and not (self._status.paused() and self._status.flying()):
            return Ending(EXIT_DONE, "done")
        if why := self._lost():
            return Ending(EXIT_FAILED, f"failed: {why}", graced=True)
        return self._nothing_left() or self._late()

    def _wait_for_paused(self) -> None:
        """Put off the timeout for as long as an operator has paused a robot."""
        now = self._status.now()
        if self._status.timeout_at is not None and self._status.paused():
            self._status.timeout_at += now - self._looked_at
        self._looked_at = now

    def _not_commanded(self) -> str:
        """Return which vehicle's autopilot is not one that Argosy commands, as text; empty if all are."""
        for name, robot in self._status.robots.items():
            for note in () if robot.health is None else robot.health.notes:
                if note.code == "autopilot_unknown":
                    return f"{name}: {note.text}"
        return ""

    def _done(self) -> bool:
        """Whether every `done` formula of the mission holds; a mission without one is never done."""
        return bool(self._mission.done) and not self._unmet()

    def _unmet(self) -> list[str]:
        """Return the `done` formulas of the mission that do not hold, each with its agent."""
        minds = {name: agent.mind for name, agent in self._model.agents.items()}
        return [
            f"{one.agent}: {one.formula}"
            for one in self._mission.done
            if (mind := minds[one.agent]) is None or not mind.done.get(one.formula, False)
        ]

    def _failed(self) -> str:
        """Return which `failed` formula of the mission holds, as text; empty if none does."""
        for one in self._mission.failed:
            mind = self._model.agents[one.agent].mind
            if mind is not None and mind.failed.get(one.formula, False):
                texts = (belief.text for belief in mind.beliefs)
                believed = next((text for text in texts if text.partition("(")[0] == one.functor), one.formula)
                return f"{one.agent} believes {printable(believed.rpartition('[source(')[0] or believed)}"
        return ""

    def _ordered(self) -> list[FleetRobot]:
        return [robot for robot in self._status.robots.values() if robot.seen.operator]

    def _stopped(self) -> str:
        """Return the operator's order once no vehicle flies and it is answered; `hold` only if an agent gave up."""
        ordered = [robot.seen.operator for robot in self._ordered()]
        self._ordered_since = (self._ordered_since or self._now()) if ordered else None
        if self._ordered_since is None or self._now() - self._ordered_since < ANSWERED or self._status.flying():
            return ""
        orders = [order for order in ordered if order in DOWN or self._failed()]
        return ", ".join(dict.fromkeys(orders))

    def _lost(self) -> str:
        """Return what the run needs and has lost, as text."""
        restart, model = self._status.setup.restart, self._model
        patience = RESTART_PATIENCE if restart else ROUTER_PATIENCE
        if not model.router_up and model.now() - (model.router_since or 0.0) > patience:
            return f"the router at {self._status.setup.router} has not answered for {patience:g} s"
        if restart:  # an agent may be dead, cut off or on its way back; a hung one is killed
            return ""
        if silent := self._silent():
            return f"{', '.join(silent)} has not answered for {SILENT_AFTER:g} s"
        robots = self._status.robots.items()
        if silent := [name for name, robot in robots if robot.since is not None and model.unheard(robot)]:
            return f"the bridge of {', '.join(silent)} has published nothing for {SILENT_AFTER:g} s"
        return ""

    def _silent(self) -> list[str]:
        """Return the agents that have not shown their minds for `SILENT_AFTER`, although the router answers."""
        long_ago = self._model.now() - SILENT_AFTER
        return sorted(
            name
            for name, agent in self._status.agents.items()
            if agent.silent is not None or not (agent.there or agent.since is None or agent.since >= long_ago)
        )

    def _nothing_left(self) -> Ending | None:
        """End the run when no agent has anything left to do and `on_idle` has brought the vehicles home.

        Without vehicles brought home only the timeout ends it, which is reported once: an agent may wait for events.
        """
        until = self._status.timeout_at
        if until is None or self._ordered() or self._status.paused() or not self._idle():
            self._idle_since, self._idle_reported = None, False
            return None
        now = self._now()
        self._idle_since = now if self._idle_since is None else self._idle_since
        if now - self._idle_since < NOTHING_LEFT:
            return None
        if home := self._brought_home():
            why = f"{', '.join(home)} was in the air without an agent in charge and was brought home (on_idle)"
            over = Ending(EXIT_FAILED, f"failed: {why}; no agent has anything left to do")
            return None if self._status.flying() else over
        if not self._idle_reported:
            self._idle_reported = True
            left = f"the mission ends at its timeout in {until - self._status.now():.0f} s"
            self._status.journal.add("argosy", f"no agent has anything left to do; {left}", "warning")
        return None

    def _idle(self) -> bool:
        """Whether every agent is heard and reports that it is idle, no action runs and no client is there to act."""
        model = self._model
        idle = all(
            agent.mind is not None and agent.mind.cycle and agent.health is not None and agent.health.idle
            for agent in self._status.agents.values()
        )
        heard = model.router_up and not self._silent()
        return heard and idle and not model.actions.open() and not model.holders("client")

    def _brought_home(self) -> list[str]:
        """Return the robots that their bridges have brought home since no agent was in charge of them."""
        robots = self._mission.robots
        unattended = [name for name, robot in self._status.robots.items() if robot.seen.unattended]
        return [name for name in unattended if robots[name].on_idle != NO_STEPS]

    def _late(self) -> Ending | None:
        speed, until = self._status.setup.speed, self._status.timeout_at
        if until is None or self._status.now() <= until:
            return None
        missing = ", ".join(self._unmet()) or "ctrl-C"
        robots = self._status.robots.items()
        left = "".join(
            f"; {name} is left to others (pilot, failsafe), in {one.seen.override}"
            for name, one in robots
            if one.seen.override
        )
        wall = "" if speed == 1 else f" of mission time ({self._mission.timeout / speed:.0f} s here)"
        limit = Duration(self._mission.timeout)
        return Ending(EXIT_FAILED, f"failed: not done within {limit}{wall}; expected {missing}{left}")
