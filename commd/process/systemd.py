"""Notify the service manager: sd_notify(3), and a watchdog that is fed by the daemon's loops.

Without a service manager (no NOTIFY_SOCKET) all of this does nothing. There is no timer: a loop that hangs does not
call `beat`, and then the watchdog is not fed although other loops still run.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Mapping

SHARE = 4
"""Turns of a loop within the watchdog's time at least, also when it is idle."""
LONGEST_STATUS = 500
"""Characters of a status line."""
log = logging.getLogger("notify")


class Unit:
    """This process as a unit of its service manager, with one or more members."""

    def __init__(self, environment: Mapping[str, str] | None = None, now: Callable[[], float] = time.monotonic) -> None:
        """`environment`: of this process by default; `now()`: wall seconds."""
        environment = os.environ if environment is None else environment
        self._now = now
        self._socket = _connected(environment.get("NOTIFY_SOCKET", ""))
        watchdog = _watchdog(environment) if self._socket is not None else None
        self.period = None if watchdog is None else watchdog / SHARE
        """Wall seconds within which each loop must turn once; None = no watchdog."""
        self._members: list[Member] = []
        self._loops: list[Loop] = []
        self._fed_at = -float("inf")
        self._owed: dict[str, str] = {}
        """Values not sent yet: the service manager's queue was full."""
        self._ready = self._stopping = False

    def member(self, name: str) -> Member:
        """Add a daemon of this process, before any of them is ready."""
        member = Member(self, name)
        self._members.append(member)
        return member

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _changed(self) -> None:
        """Send the changed status; READY=1 and STOPPING=1 when all members are."""
        several = len(self._members) > 1
        words = [f"{one.name}: {one.words}" if several else one.words for one in self._members if one.words]
        values = {"STATUS": "; ".join(words)[:LONGEST_STATUS]}
        if not self._ready and all(one.is_ready for one in self._members):
            self._ready = True
            values["READY"] = "1"
        if not self._stopping and all(one.is_stopping for one in self._members):
            self._stopping = True
            values["STOPPING"] = "1"
        self._send(values)

    def _turned(self) -> None:
        """Feed the watchdog if all loops have turned since, no more often than needed."""
        if self.period is None or self._now() - self._fed_at < self.period / 2:
            return
        if all(one.turned or one.resting for one in self._loops):
            self._fed_at = self._now()
            for one in self._loops:
                one.turned = False
            self._send({"WATCHDOG": "1"})

    def _send(self, values: Mapping[str, str]) -> None:
        if self._socket is None:
            return
        self._owed |= values
        try:
            self._socket.send("\n".join(f"{name}={value}" for name, value in self._owed.items()).encode())
        except OSError as error:
            log.debug("not_told why=%s", error)  # it is sent with the next values
        else:
            self._owed.clear()


class Member:
    """A daemon of this process, such as `agentd`."""

    def __init__(self, unit: Unit, name: str) -> None:
        self._unit, self.name = unit, name
        self.words = ""
        self.is_ready = self.is_stopping = False
        self.period = unit.period
        """Wall seconds within which each loop must turn once; None = no watchdog."""

    def ready(self, words: str) -> None:
        """Report that it serves: session, subscriptions and token are up. `words` as in `status`."""
        self.is_ready, self.words = True, _line(words)
        self._unit._changed()

    def status(self, *words: str) -> None:
        """Report a status for people, if it has changed."""
        text = _line("; ".join(words))
        if text != self.words:
            self.words = text
            self._unit._changed()

    def stopping(self, words: str = "") -> None:
        """Report that it is about to end."""
        self.is_stopping, self.words = True, _line(words) or self.words
        self._unit._changed()

    def loop(self) -> Loop:
        """Add a loop, without whose turns the watchdog is not fed."""
        loop = Loop(self._unit)
        self._unit._loops.append(loop)
        return loop


class Loop:
    """A loop of a daemon: it calls `beat` at each turn, at least every `period` seconds even when idle."""

    def __init__(self, unit: Unit) -> None:
        self._unit = unit
        self.turned, self.resting = True, False
        self.period = unit.period
        """Wall seconds within which it must turn once; None = no watchdog."""

    @classmethod
    def unwatched(cls) -> Loop:
        """Return a loop without a watchdog."""
        return cls(Unit({}))

    def beat(self) -> None:
        """Report a turn."""
        self.turned, self.resting = True, False
        self._unit._turned()

    def rest(self) -> None:
        """Suspend the watchdog of this loop until its next `beat`, for a long wait such as a name lookup."""
        self.resting = True

    def end(self) -> None:
        """Remove the loop."""
        if self in self._unit._loops:
            self._unit._loops.remove(self)


def _line(text: str) -> str:
    return " ".join(text.split())


def _connected(address: str) -> socket.socket | None:
    """Return the socket of the service manager, if any: a path, or an abstract name behind an `@`."""
    if not address:
        return None
    if address[0] not in "/@":
        log.warning("NOTIFY_SOCKET=%s is neither a path nor an abstract name: nothing is sent", address)
        return None
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
    try:
        manager.connect("\0" + address[1:] if address[0] == "@" else address)
    except OSError as error:
        manager.close()
        log.warning("NOTIFY_SOCKET=%s cannot be reached, nothing is sent: %s", address, error.strerror or error)
        return None
    return manager


def _watchdog(environment: Mapping[str, str]) -> float | None:
    """Return the watchdog's timeout in seconds, if there is one."""
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    try:
        microseconds = int(environment.get("WATCHDOG_USEC", "0"))
    except ValueError:
        log.warning("WATCHDOG_USEC=%s is no number: the watchdog is not fed", environment["WATCHDOG_USEC"])
        return None
    return microseconds / 1e6 if microseconds > 0 else None
