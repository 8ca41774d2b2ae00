"""A service manager's end of sd_notify(3): a real datagram socket, and what was said to it."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from pathlib import Path


class NotifySocket:
    """Listens at a path, or at an abstract name that begins with `@`."""

    def __init__(self, address: str | Path) -> None:
        self.address = str(address)
        self.said: list[dict[str, str]] = []
        """Each datagram, its fields by name."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + self.address[1:] if self.address[0] == "@" else self.address)

    def __enter__(self) -> NotifySocket:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def environment(self, watchdog: float | None = None, pid: int | None = None) -> dict[str, str]:
        """What systemd sets for a unit with `Type=notify`, and `WatchdogSec=` of so many seconds."""
        found = {"NOTIFY_SOCKET": self.address}
        if watchdog is not None:
            found["WATCHDOG_USEC"] = str(int(watchdog * 1e6))
        if pid is not None:
            found["WATCHDOG_PID"] = str(pid)
        return found

    def take(self) -> list[dict[str, str]]:
        """Return all that was said, with what has come by now."""
        self._read(0)
        return self.said

    def fields(self, name: str) -> list[str]:
        """Return the values of one field in the order in which they came."""
        return [one[name] for one in self.take() if name in one]

    def until(self, condition: Callable[[], bool], wish: str, seconds: float = 90) -> None:
        """Wait until what was said fulfils a condition."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise AssertionError(f"not within {seconds:g} s: {wish}; it was told {self.said}")
            self._read(0.05)

    def _read(self, wait: float) -> None:
        self._socket.settimeout(wait or 0.001)
        while True:
            try:
                text = self._socket.recv(65_536).decode()
            except (TimeoutError, BlockingIOError):
                return
            self.said.append(dict(line.split("=", 1) for line in text.splitlines()))
