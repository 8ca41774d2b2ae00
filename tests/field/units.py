"""A small service manager for tests: it starts a daemon as its unit file says, and does to it what systemd would.

What counts here is taken from the units that Argosy ships: `Type=notify` with a real notify socket, `WatchdogSec`
(SIGABRT and SIGCONT, then SIGKILL after `TimeoutAbortSec`), `Restart=on-failure` after `RestartSec`, and
`RestartPreventExitStatus`. Limits on restarts, users and sandboxes are systemd's own, and not emulated.
"""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from schemas.files.units import Duration
from tests.support.notify_socket import NotifySocket
from tests.support.processes import ROOT

UNITS = ROOT / "deploy" / "systemd"
_LOOK = 0.02


@dataclass(frozen=True)
class UnitFile:
    """The settings of a unit that this manager knows, in seconds."""

    watchdog: float
    restart_after: float
    abort: float
    not_restarted: frozenset[int]
    """Exit codes after which it is not started again."""

    @classmethod
    def read(cls, daemon: str) -> UnitFile:
        """Read the unit that is shipped for a daemon."""
        text = (UNITS / f"{daemon}@.service").read_text()
        settings = dict(re.findall(r"^(\w+)=(.*)$", text, re.MULTILINE))
        assert settings["Restart"] == "on-failure"
        codes = frozenset(map(int, settings.get("RestartPreventExitStatus", "").split()))
        seconds = [float(Duration.read(settings[name])) for name in ("WatchdogSec", "RestartSec", "TimeoutAbortSec")]
        return cls(*seconds, not_restarted=codes)


@dataclass
class Happened:
    """What became of a unit."""

    ready: list[float] = field(default_factory=list)
    """When each life was ready; monotonic seconds, as all times here."""
    watchdog: list[float] = field(default_factory=list)
    """When the watchdog found it hung."""
    ended: list[tuple[float, int]] = field(default_factory=list)
    """When each life ended, and its exit code (negative: the signal)."""


class Managed:
    """A daemon under this manager. It ends with `close`."""

    def __init__(
        self,
        unit: UnitFile,
        arguments: Sequence[str],
        folder: Path,
        *,
        within: Sequence[str] = (),
        environment: dict[str, str] | None = None,
        restart: bool = True,
        watchdog: bool = True,
    ) -> None:
        """Run `python -m ARGUMENTS`; without `restart` it is left dead, without `watchdog` left hung."""
        self.name, self.happened = arguments[0], Happened()
        self.lines: list[tuple[float, str]] = []
        self._unit, self._restart, self._watchdog = unit, restart, watchdog
        self._command = [*within, sys.executable, "-m", *arguments]
        self._socket = NotifySocket(folder / f"notify-{len(list(folder.glob('notify-*')))}")
        told = self._socket.environment(unit.watchdog if watchdog else None)
        self._environment = {**os.environ, **(environment or {}), **told, "PYTHONUNBUFFERED": "1"}
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._manage, daemon=True)
        self._start()
        self._thread.start()

    @property
    def text(self) -> str:
        """All that it has said, in all of its lives."""
        return "\n".join(line for _, line in self.lines)

    def said(self, words: str, after: float = 0.0) -> float | None:
        """Return when it said something that has these words, first after a moment; None if it has not."""
        return next((at for at, line in list(self.lines) if at >= after and words in line), None)

    def signal(self, number: int) -> float:
        """Send a signal to the daemon; returns when."""
        at = time.monotonic()
        os.kill(self._daemon_pid(), number)
        return at

    def close(self) -> None:
        """Kill it and manage no more."""
        self._closing.set()
        self._thread.join(20)
        self._kill()
        self._socket.__exit__()

    def _daemon_pid(self) -> int:
        """`ip netns exec` becomes the daemon by exec: it is the same process."""
        return self._process.pid

    def _start(self) -> None:
        self._process = subprocess.Popen(
            self._command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            errors="replace",
            cwd=ROOT,
            env=self._environment,
            start_new_session=True,
        )
        threading.Thread(target=self._read, args=(self._process,), daemon=True).start()
        self._fed: float | None = None

    def _read(self, process: subprocess.Popen[str]) -> None:
        for line in process.stdout:
            self.lines.append((time.monotonic(), line.rstrip("\n")))

    def _manage(self) -> None:
        heard, dead_since = 0, None
        while not self._closing.is_set():
            time.sleep(_LOOK)
            now, told = time.monotonic(), self._socket.take()
            for message in told[heard:]:
                if "READY" in message:
                    self.happened.ready.append(now)
                if "READY" in message or "WATCHDOG" in message:
                    self._fed = now
            heard = len(told)
            code = self._process.poll()
            if code is None:
                if self._watchdog and self._fed is not None and now - self._fed > self._unit.watchdog:
                    self._abort(now)
            elif dead_since is None:
                self.happened.ended.append((now, code))
                dead_since = now
            elif self._goes_on(code) and now - dead_since >= self._unit.restart_after:
                self._start()
                dead_since = None

    def _goes_on(self, code: int) -> bool:
        return self._restart and code not in (0, *self._unit.not_restarted)

    def _abort(self, now: float) -> None:
        self.happened.watchdog.append(now)
        self._fed = None
        self.signal(signal.SIGABRT)
        self.signal(signal.SIGCONT)
        try:
            self._process.wait(self._unit.abort)
        except subprocess.TimeoutExpired:
            self._kill()

    def _kill(self) -> None:
        if self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait(10)
