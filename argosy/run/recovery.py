"""What keeps a run going, and ends it with vehicles in the air.

Hung daemons are killed, to be restarted. At the end: the programs' grace, the way home, the wait for disarmed vehicles.
"""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Callable, Collection, Mapping

from argosy.fleet_model.members import FleetRobot, Member
from argosy.processes.supervisor import Child, Restarts, Supervisor
from argosy.run.armed_warnings import left_alone
from argosy.run.end_conditions import EndConditions, Ending
from argosy.run.run_status import Status
from commd.common.tasks import wait_at_most
from schemas.liveness import FIRST_HEALTH, HUNG_AFTER

REFRESH = 0.25
"""Wall seconds between two checks of vehicles and daemons."""
REPORTED_EVERY = 10.0
"""Wall seconds between two lines of the countdown."""
HEARD_WITHIN = 30.0
"""Wall seconds that a restarted bridge has to hear its vehicles, before it is ordered to leave in any case."""
NEEDED = ("commd", "bridged")
"""Daemons without which no vehicle comes home, or it is not seen."""


class Watchdog:
    """Finds hung daemons of a run, a few times a second, and kills them, so that they are restarted."""

    def __init__(self, status: Status) -> None:
        self._status = status
        self._since: dict[int, float] = {}
        """Monotonic time since when a process hangs, by process id."""

    def look(self, kinds: Collection[str] | None = None) -> None:
        """Kill daemons of these kinds (None: of all) that hang for too long."""
        now = time.monotonic()
        for child in self._status.children:
            if kinds is not None and child.process.kind.name not in kinds:
                continue
            stopped = child.stopped
            if not (child.alive and child.process.kind.daemon and (stopped or self._is_silent(child))):
                self._since.pop(child.pid, None)
            elif now - self._since.setdefault(child.pid, now) >= HUNG_AFTER:
                how = "is stopped" if stopped else "publishes nothing"
                text = f"hangs: it {how} for {HUNG_AFTER:g} s, and is killed"
                self._status.journal.add(child.name, text, "warning")
                child.signal(signal.SIGKILL)
                self._since.pop(child.pid)

    def _is_silent(self, child: Child) -> bool:
        """Whether a daemon is silent on the bus although its board is reached."""
        if time.monotonic() - child.started < FIRST_HEALTH:
            return False
        status, model = self._status, self._status.model
        kind, board, lost = child.process.kind.name, child.process.board, not model.router_up
        if kind == "commd":  # of another board only the link may be cut
            return lost and board == status.setup.mission.board_names[0]
        if lost or board not in model.holders("commd"):
            return False
        members: Mapping[str, Member] = model.agents if kind == "agentd" else model.robots
        return all(name not in members or model.unheard(members[name]) for name in child.process.subject.split())


class Recovery:
    """Keeps the daemons that bring vehicles home alive, and waits for the vehicles."""

    def __init__(
        self,
        status: Status,
        supervisor: Supervisor,
        end_conditions: EndConditions,
        watchdog: Watchdog,
        restarts: Restarts,
    ) -> None:
        self.hurry = asyncio.Event()
        """Set when the user wants to leave, even with vehicles in the air."""
        self._status, self._supervisor, self._end_conditions = status, supervisor, end_conditions
        self._watchdog, self._restarts = watchdog, restarts
        self._mission, self._journal = status.setup.mission, status.journal

    async def outlasts_grace(self, ending: Ending, interrupted: Callable[[], str]) -> Ending | None:
        """Let the programs bring their vehicles home before a failure counts. Returns what ends the run, if it does.

        The grace stops while an operator has paused a robot: the run does not bring that home.
        """
        left, looked = self._mission.grace, time.monotonic()
        be = "are" if any(robot.seen.armed for robot in self.armed()) else "may be"
        warning = (
            f"{ending.text}; vehicles {be} armed: their programs have {left:g} wall seconds before the mission ends"
        )
        on = ", counted from `argosy stop continue` on" if self._paused() else ""
        self._journal.add("argosy", warning + on, "warning")
        while self.armed() and not interrupted() and left > 0:
            paused = self._paused()
            what = f"the operator, {', '.join(paused)} paused" if paused else f"the programs, {left:.0f} s"
            self._status.waiting_for = f"{what}: {ending.text}"
            self._look_after_daemons()
            if (holds := self._end_conditions.look()) is None:
                self._status.waiting_for = ""
                self._journal.add("argosy", f"the mission goes on, this is over: {ending.why}", "good")
                return None
            if not (ending := holds).graced:
                break
            await asyncio.sleep(REFRESH)
            now = time.monotonic()
            left, looked = left if paused else left - (now - looked), now
        self._status.waiting_for = ""
        return ending

    async def bring_home(self, interrupted: Callable[[], str]) -> str:
        """Have the bridges bring every armed vehicle home; wait until it is disarmed or a pilot's, within the bound.

        Returns which vehicles were left armed and are not a pilot's, and why; empty if there is none.
        """
        status, asked, reported = self._status, set[Child](), 0.0
        until = status.now() + self._mission.bring_home
        while not self.hurry.is_set() and (left := until - status.now()) > 0:
            self._look_after_daemons()
            if not (away := [robot for robot in self.armed() if robot.name in self._bridged()]):
                break
            for bridge in self._supervisor.of_kind("bridged"):
                if bridge.alive and bridge not in asked and not self._unheard(bridge):
                    asked.add(bridge)
                    bridge.ask_to_leave()
            leaves = "ctrl-C again leaves" if interrupted() else "ctrl-C twice leaves"
            status.waiting_for = f"{', '.join(map(_where, away))} to be disarmed, {left:.0f} s left; {leaves}"
            if time.monotonic() - reported >= REPORTED_EVERY:
                reported = time.monotonic()
                self._journal.add("argosy", f"waiting for {status.waiting_for}", "warning")
            await wait_at_most(self.hurry, REFRESH)
        status.waiting_for = ""
        if not (alone := [robot for robot in self.armed() if left_alone(status, robot)]):
            return ""
        why = "no bridge is there to bring it home"
        if self.hurry.is_set():
            why = f"left by {interrupted()}"
        elif status.now() >= until:
            why = f"`bring_home` ran out after {self._mission.bring_home:g} s"
        return f"{', '.join(map(_where, alone))} left armed: {why}"

    def armed(self) -> list[FleetRobot]:
        """Return the vehicles that are armed, or may be, without those whose simulator is dead.

        One that was armed when it fell silent counts, and one that its restarted bridge has not heard yet: it may have
        been armed meanwhile. A bridge that has left a vehicle disarmed has the last word: the view may have missed it.
        """
        unheard = {name for bridge in self._supervisor.of_kind("bridged") for name in self._unheard(bridge)}
        robots = self._status.robots.values()
        may_be = (robot for robot in robots if robot.seen.armed or robot.name in unheard)
        down = {name for name, left in self._status.left.items() if left.state == "disarmed"}
        return [robot for robot in may_be if robot.name not in down and not self.simulator_is_dead(robot.name)]

    def simulator_is_dead(self, robot: str) -> bool:
        """Whether the simulator of a robot is dead, and so the robot."""
        simulators = self._supervisor.of_kind("simulator")
        return any(not child.alive for child in simulators if child.process.subject == robot)

    def _look_after_daemons(self) -> None:
        """Restart needed daemons that are dead or hang, even if the mission has no restarts."""
        self._watchdog.look(NEEDED)
        for child in self._supervisor.dead():
            if child.process.kind.name in NEEDED and not all(
                map(self.simulator_is_dead, child.process.subject.split())
            ):
                self._restarts.died(child, anyway=True)
        self._restarts.report_restarted(self._status.serves)

    def _paused(self) -> list[str]:
        """Return the paused robots that an operator can continue: their bridge runs, or is restarted."""
        return [name for name in self._status.paused() if name in self._bridged()]

    def _bridged(self) -> set[str]:
        bridges = [child for child in self._supervisor.of_kind("bridged") if child.alive or child.replaced]
        return {name for bridge in bridges for name in bridge.process.subject.split()}

    def _unheard(self, bridge: Child) -> list[str]:
        """Return the vehicles that were heard before a bridge was started, and not since, for `HEARD_WITHIN`.

        On SIGTERM a bridge leaves unheard vehicles as if they were on the ground.
        """
        age = time.monotonic() - bridge.started if bridge.alive else 0.0
        if age > HEARD_WITHIN or not (bridge.alive or bridge.replaced):
            return []
        since, robots = self._status.model.now() - age, self._status.robots
        return [name for name in bridge.process.subject.split() if 0 < robots[name].seen.heard <= since]


def _where(robot: FleetRobot) -> str:
    seen = robot.seen
    height = "" if seen.altitude is None else f", {seen.altitude + 0.0:.0f} m up"
    return f"{robot.name} ({'LOST' if seen.lost else seen.mode}{height})"
