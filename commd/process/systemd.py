"""What this process tells the service manager that started it: sd_notify(3), and a watchdog fed by the loops at work.

Without a service manager (no NOTIFY_SOCKET) all of this does nothing. There is no timer here: of a loop that hangs, or
does not come round, no `beat` comes, and then the watchdog is not fed although others still turn.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Mapping

SHARE = 4
"""A loop turns at least so often within the watchdog's time, also when it has nothing to do."""
LONGEST_STATUS = 500
"""Characters of a status line."""
log = logging.getLogger("notify")


class Unit:
    """This process as its service manager knows it; it is made of one member, or of several in one process."""

    def __init__(self, environment: Mapping[str, str], now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._socket = _connected(environment.get("NOTIFY_SOCKET", ""))
        watchdog = _watchdog(environment) if self._socket is not None else None
        self.period = None if watchdog is None else watchdog / SHARE
        """Wall seconds within which each loop is to turn once; None = nobody looks."""
        self._members: list[Member] = []
        self._loops: list[Loop] = []
        self._fed_at = -float("inf")
        self._owed: dict[str, str] = {}
        """What could not be said yet: the service manager's queue was full."""
        self._ready = self._stopping = False

    @classmethod
    def of_environment(cls) -> Unit:
        """Return this process as the environment describes it."""
        return cls(os.environ)

    def member(self, name: str) -> Member:
        """Add a daemon of this process, before any of them is ready."""
        member = Member(self, name)
        self._members.append(member)
        return member

    def close(self) -> None:
        """Say nothing any more."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _changed(self) -> None:
        """A member has something new to say: READY=1 and STOPPING=1 go out when all of them are."""
        several = len(self._members) > 1
        words = [f"{one.name}: {one.words}" if several else one.words for one in self._members if one.words]
        told = {"STATUS": "; ".join(words)[:LONGEST_STATUS]}
        if not self._ready and all(one.is_ready for one in self._members):
            self._ready = True
            told["READY"] = "1"
        if not self._stopping and all(one.is_stopping for one in self._members):
            self._stopping = True
            told["STOPPING"] = "1"
        self._say(told)

    def _turned(self) -> None:
        """A loop has turned: feed the watchdog if all have since it was fed, no more often than needed."""
        if self.period is None or self._now() - self._fed_at < self.period / 2:
            return
        if all(one.turned or one.resting for one in self._loops):
            self._fed_at = self._now()
            for one in self._loops:
                one.turned = False
            self._say({"WATCHDOG": "1"})

    def _say(self, told: Mapping[str, str]) -> None:
        if self._socket is None:
            return
        self._owed |= told
        try:
            self._socket.send("\n".join(f"{name}={value}" for name, value in self._owed.items()).encode())
        except OSError as error:
            log.debug("not_told why=%s", error)  # it is said with what is said next
        else:
            self._owed.clear()


class Member:
    """A daemon of this process, such as `agentd`."""

    def __init__(self, unit: Unit, name: str) -> None:
        self._unit, self.name = unit, name
        self.words = ""
        self.is_ready = self.is_stopping = False

    @property
    def period(self) -> float | None:
        """Wall seconds within which each loop is to turn once; None = nobody looks."""
        return self._unit.period

    def ready(self, words: str) -> None:
        """Say that it serves: session, subscriptions and token are up. `words` as in `status`."""
        self.is_ready, self.words = True, _line(words)
        self._unit._changed()

    def status(self, *words: str) -> None:
        """Say what it does now, in words; what was said already is not said again."""
        text = _line("; ".join(words))
        if text != self.words:
            self.words = text
            self._unit._changed()

    def stopping(self, words: str = "") -> None:
        """Say that it is about to end."""
        self.is_stopping, self.words = True, _line(words) or self.words
        self._unit._changed()

    def loop(self) -> Loop:
        """Add a loop at work, without whose turns the watchdog is not fed."""
        loop = Loop(self._unit)
        self._unit._loops.append(loop)
        return loop


class Loop:
    """A loop at work: it says so at each turn, and turns at least every `period` seconds with nothing to do."""

    def __init__(self, unit: Unit) -> None:
        self._unit = unit
        self.turned, self.resting = True, False

    @classmethod
    def unwatched(cls) -> Loop:
        """Return a loop that nobody waits for."""
        return cls(Unit({}))

    @property
    def period(self) -> float | None:
        """Wall seconds within which it is to turn once; None = nobody looks."""
        return self._unit.period

    def beat(self) -> None:
        """Say that it has come round."""
        self.turned, self.resting = True, False
        self._unit._turned()

    def rest(self) -> None:
        """It waits for what may take long, such as a name to be looked up: it is not missed until its next beat."""
        self.resting = True

    def end(self) -> None:
        """It has come to its end: nobody waits for its turns any more."""
        if self in self._unit._loops:
            self._unit._loops.remove(self)


def _line(text: str) -> str:
    return " ".join(text.split())


def _connected(address: str) -> socket.socket | None:
    """Return the socket of the service manager, if there is one: a path, or an abstract name behind an `@`."""
    if not address:
        return None
    if address[0] not in "/@":
        log.warning("NOTIFY_SOCKET=%s is neither a path nor an abstract name: nothing is told", address)
        return None
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
    try:
        manager.connect("\0" + address[1:] if address[0] == "@" else address)
    except OSError as error:
        manager.close()
        log.warning("NOTIFY_SOCKET=%s cannot be reached, nothing is told: %s", address, error.strerror or error)
        return None
    return manager


def _watchdog(environment: Mapping[str, str]) -> float | None:
    """Return the seconds after which the service manager takes this process for hung, if it looks at all."""
    if environment.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    try:
        microseconds = int(environment.get("WATCHDOG_USEC", "0"))
    except ValueError:
        log.warning("WATCHDOG_USEC=%s is no number: the watchdog is not fed", environment["WATCHDOG_USEC"])
        return None
    return microseconds / 1e6 if microseconds > 0 else None
