"""Find the routers of missions that run on this machine: `argosy run` may choose a free port."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import re
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

import msgspec

from commd.bus.bus import open_bus
from commd.bus.errors import BusError
from schemas.files.findings import Findings
from schemas.wire import keys

log = logging.getLogger("runs")
START_PATIENCE = 90.0
"""Wall seconds that a run waits for another one that starts with the same router."""
PROBE_PATIENCE = 1.0
"""Wall seconds to reach a router, and for it to show which daemons are there."""


class LocalRun(msgspec.Struct, frozen=True):
    """A present run; its file is locked while the process lives."""

    fleet: str
    router: str
    """Endpoint of the first board's router."""
    network: int
    """Inode of the network namespace, which has a loopback of its own."""


@contextmanager
def announced(fleet: str, router: str) -> Iterator[None]:
    """Let others on this machine find the router of a run; if no file can be written, they must name it."""
    path = _folder() / f"{os.getpid()}.json"
    try:
        file = _opened(path)
    except OSError as error:
        log.warning("commands on this machine must name the router of this run: %s", error)
        yield
        return
    with file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.write(msgspec.json.encode(LocalRun(fleet, router, _network())))
        file.flush()
        try:
            yield
        finally:
            path.unlink(missing_ok=True)


@contextmanager
def starting(router: str, waits: Callable[[], None], patience: float = START_PATIENCE) -> Iterator[None]:
    """Let the runs with one router choose and bind their ports one after the other.

    Otherwise another run could bind a port that was found free, and clients would join its fleet. `waits` is called
    once if another run is starting; after `patience` wall seconds, or if no file can be written, the run continues.
    """
    path = _folder() / f"{re.sub(r'[^0-9A-Za-z]+', '_', router)[:100]}.starting"
    try:
        file = _opened(path)
    except OSError:
        yield
        return
    with file:
        until, reported = time.monotonic() + patience, False
        while not _locks(file.fileno(), fcntl.LOCK_EX):
            if not reported:
                reported = True
                waits()
            if time.monotonic() >= until:
                break
            time.sleep(0.1)
        yield


def local_runs(fleet: str = "") -> list[LocalRun]:
    """Return the present runs, of this fleet or of all."""
    found = []
    folder = _folder()
    for path in sorted(folder.glob("*.json")) if _is_own(folder) else ():
        with suppress(OSError, msgspec.DecodeError), path.open("rb") as file:
            if not _locks(file.fileno(), fcntl.LOCK_SH):  # its process lives
                found.append(msgspec.json.decode(file.read(), type=LocalRun))
    return [run for run in found if run.network == _network() and fleet in ("", run.fleet)]


async def router_of(fleet: str, otherwise: str) -> str:
    """Return the router of the only run of this fleet (empty: of any); `otherwise` if there is none.

    For a mission that names no router. Raises Findings if there are several: also if daemons of the fleet that no run
    has started are at `otherwise`, so that an order to robots in the air does not go to a simulation of them.
    """
    runs = local_runs(fleet)
    there = {run.router: f"{run.fleet} at {run.router}" for run in runs}
    if there and otherwise not in {run.router for run in local_runs()} and await _serves(otherwise, fleet):
        there[otherwise] = f"daemons {f'of {fleet} ' if fleet else ''}at {otherwise}"
    if len(there) > 1:
        which = "name one by --router" if fleet else "name one by --fleet or --router"
        text = f"several missions run on this machine, {', '.join(there.values())}: {which}"
        raise Findings.about("argosy", text)
    return next(iter(there), otherwise)


async def _serves(router: str, fleet: str) -> bool:
    """Whether a daemon of a fleet (empty: of any) is at a router."""
    try:
        async with open_bus(
            router, fleet=fleet or "any", name="operator", daemon="argosy", patience=PROBE_PATIENCE
        ) as bus:
            return bool(await bus.tokens(keys.alive(fleet or "*", "*", "*", "*"), PROBE_PATIENCE))
    except BusError:
        return False


def _locks(file: int, kind: int) -> bool:
    """Lock a file. Returns False if another process holds it."""
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _opened(path: Path) -> BinaryIO:
    """Open a file of ours to be written. Raises OSError, also for a folder that another user has made for us.

    In a folder of another's a link could lead to any file of ours.
    """
    path.parent.mkdir(mode=0o700, exist_ok=True)
    if not _is_own(path.parent):
        raise PermissionError(errno.EPERM, "it belongs to another user, or others may write in it", str(path.parent))
    return os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600), "wb")


def _is_own(folder: Path) -> bool:
    """Whether it is a folder of this user in which nobody else may write, and no link to one."""
    with suppress(OSError):
        found = folder.lstat()
        return stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return False


def _folder() -> Path:
    if not (folder := os.environ.get("XDG_RUNTIME_DIR")):
        import tempfile  # imports ten modules more, which a program that names its router does not need

        folder = tempfile.gettempdir()
    return Path(folder) / f"argosy-{os.getuid()}"


def _network() -> int:
    return os.stat("/proc/self/ns/net").st_ino
