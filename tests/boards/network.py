"""Boards as network namespaces (`ip netns`): each has its own loopback and a cable to a switch, which can be cut.

The switch is a bridge in a namespace of its own, the ground, where simulators run. All names begin with `argosy-` and
the process that made them; what a crashed run has left behind goes when the next network is made.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Iterable
from types import TracebackType

GROUND = "ground"
GROUND_ADDRESS = "10.77.0.100"
_OURS = re.compile(r"argosy-(\d+)-\d+-")
_SWITCH = "field"
_CABLE = "cable"
_END_PATIENCE = 30.0
"""Seconds that killed processes have to be gone."""
_count = itertools.count()


class NoNamespaces(RuntimeError):
    """This machine lets us make no network namespaces; the text says why."""


def possible() -> None:
    """Try whether namespaces, cables and a switch can be made here. Raises NoNamespaces."""
    if shutil.which("ip") is None:
        raise NoNamespaces("there is no `ip`: install iproute2")
    if os.geteuid():
        raise NoNamespaces("network namespaces need root")
    try:
        with Network(["probe"]):
            pass
    except subprocess.CalledProcessError as error:
        raise NoNamespaces(f"`{' '.join(error.cmd)}`: {error.stderr.strip()}") from None


class Network:
    """Boards called by name, at 10.77.0.1, 10.77.0.2, ..., and the ground at 10.77.0.100."""

    def __init__(self, boards: Iterable[str]) -> None:
        self.addresses = {name: f"10.77.0.{number}" for number, name in enumerate(boards, 1)}
        self._tag = f"argosy-{os.getpid()}-{next(_count)}"

    def __enter__(self) -> Network:
        sweep()
        try:
            self._make()
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._remove()

    def within(self, place: str) -> tuple[str, ...]:
        """Return what stands before a command that is to run on a board, or on the ground."""
        return ("ip", "netns", "exec", self.namespace(place))

    def namespace(self, place: str) -> str:
        """Return the namespace of a board, or of the ground."""
        return f"{self._tag}-{place}"

    def unplug(self, board: str) -> None:
        """Cut a board off silently: its cable ends nowhere. It is told nothing, and every packet is lost."""
        self._ip(GROUND, "link", "set", board, "nomaster")

    def plug(self, board: str) -> None:
        """End an `unplug`."""
        self._ip(GROUND, "link", "set", board, "master", _SWITCH)

    def down(self, board: str) -> None:
        """Take a board's own interface down: the kernel there knows, and refuses what is to be sent."""
        self._ip(board, "link", "set", _CABLE, "down")

    def up(self, board: str) -> None:
        """End a `down`."""
        self._ip(board, "link", "set", _CABLE, "up")

    def part(self, one: str, other: str) -> None:
        """Cut the way between two boards, both of which still reach all others."""
        for here, there in ((one, other), (other, one)):
            self._ip(here, "route", "replace", "blackhole", f"{self.addresses[there]}/32")

    def join(self, one: str, other: str) -> None:
        """End a `part`."""
        for here, there in ((one, other), (other, one)):
            self._ip(here, "route", "del", "blackhole", f"{self.addresses[there]}/32")

    def _make(self) -> None:
        places = [GROUND, *self.addresses]
        for place in places:
            _run("ip", "netns", "add", self.namespace(place))
            self._ip(place, "link", "set", "lo", "up")
        self._ip(GROUND, "link", "add", "name", _SWITCH, "type", "bridge")
        self._ip(GROUND, "link", "set", _SWITCH, "up")
        self._ip(GROUND, "addr", "add", f"{GROUND_ADDRESS}/24", "dev", _SWITCH)
        for board, address in self.addresses.items():
            end = ("peer", "name", _CABLE, "netns", self.namespace(board))
            self._ip(GROUND, "link", "add", "name", board, "type", "veth", *end)
            self._ip(GROUND, "link", "set", board, "master", _SWITCH, "up")
            self._ip(board, "addr", "add", f"{address}/24", "dev", _CABLE)
            self._ip(board, "link", "set", _CABLE, "up")

    def _ip(self, place: str, *arguments: str) -> None:
        _run("ip", "-n", self.namespace(place), *arguments)

    def _remove(self) -> None:
        for name in _namespaces():
            if name.startswith(f"{self._tag}-"):
                _delete(name)


def sweep() -> None:
    """Remove the namespaces of runs that ended without removing them, and end what still runs there."""
    for name in _namespaces():
        found = _OURS.match(name)
        if found is not None and not os.path.exists(f"/proc/{found[1]}"):
            _delete(name)


def _namespaces() -> list[str]:
    return [line.split()[0] for line in _run("ip", "netns", "list").splitlines() if line]


def _delete(name: str) -> None:
    """Kill what runs in a namespace, by process id, and remove it."""
    until = time.monotonic() + _END_PATIENCE
    while (pids := _pids(name)) and time.monotonic() < until:
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(int(pid), signal.SIGKILL)
        time.sleep(0.02)
    while name in _namespaces():  # it may be busy, or be deleted by another run that tidies up
        if time.monotonic() > until:
            _run("ip", "netns", "del", name)
        with contextlib.suppress(subprocess.CalledProcessError):
            _run("ip", "netns", "del", name)


def _pids(name: str) -> list[str]:
    """Return the processes of a namespace; none if another run that tidies up has deleted it."""
    try:
        return _run("ip", "netns", "pids", name).split()
    except subprocess.CalledProcessError:
        if name in _namespaces():
            raise
        return []


def _run(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=20).stdout
