"""Finds hung daemons and kills them, so that they are restarted."""

from __future__ import annotations

import signal
import time
from collections.abc import Collection, Mapping

from argosy.fleet_model.members import Member
from argosy.processes.supervisor import Child
from argosy.run.run_status import Status
from schemas.liveness import FIRST_HEALTH, HUNG_AFTER


class Watchdog:
    """Checks the daemons of a run, a few times a second."""

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
