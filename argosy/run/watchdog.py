"""Finds daemons that run and do nothing, and kills them, so that they are started again."""

from __future__ import annotations

import signal
import time
from collections.abc import Collection
from math import inf
from pathlib import Path

from argosy.fleet_model.snapshot import Observer
from argosy.processes.supervisor import Child
from argosy.run.run_status import Status

PATIENCE = 15.0
"""Wall seconds that a daemon may be silent although its board is heard, or be stopped, until it counts as hung."""
COMING_UP = 30.0
"""Wall seconds after its start before the silence of a daemon counts."""
HEALTHY = 3.0
"""Wall seconds within which each daemon that is well says so again; it does once a second."""


class Watchdog:
    """Looks at the daemons of a run, a few times a second."""

    def __init__(self, status: Status) -> None:
        self.observer: Observer | None = None
        """Once there is a bus."""
        self._status = status
        self._since: dict[int, float] = {}
        """By process id: since when it does nothing."""

    def look(self, kinds: Collection[str] | None = None) -> None:
        """Kill what has done nothing for too long, of these kinds (None: of all)."""
        now = time.monotonic()
        for child in self._status.children:
            if kinds is not None and child.process.kind.name not in kinds:
                continue
            stopped = is_stopped(child.pid)
            if not (child.alive and child.process.kind.daemon and (stopped or self._is_silent(child))):
                self._since.pop(child.pid, None)
            elif now - self._since.setdefault(child.pid, now) >= PATIENCE:
                how = "is stopped" if stopped else "says nothing"
                text = f"hangs: it {how} for {PATIENCE:g} s, and is killed"
                self._status.journal.add(child.name, text, "warning")
                child.signal(signal.SIGKILL)
                self._since.pop(child.pid)

    def _is_silent(self, child: Child) -> bool:
        """Whether a daemon says nothing on the bus although the way to its board is open."""
        if self.observer is None or time.monotonic() - child.started < COMING_UP:
            return False
        kind, board, lost = child.process.kind.name, child.process.board, self.observer.router_lost is not None
        status = self._status
        if kind == "commd":  # of another board maybe only the link is cut
            return lost and board == status.setup.mission.board_names[0]
        if lost or not status.picture.is_alive(board, "commd"):
            return False
        old = status.now() - HEALTHY * status.setup.speed
        return all(status.picture.heard_at.get((name, kind), -inf) < old for name in child.process.subject.split())


def is_stopped(pid: int) -> bool:
    """Whether a process was stopped by a signal, or by a debugger."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"
    except (OSError, IndexError):
        return False
