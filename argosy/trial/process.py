"""The processes of a trial: each runs the entry point of its command as tasks of the one event loop, and can be killed.

Every task, timer and callback belongs to the process in whose context it was made. A process that is killed never runs
again: nothing of it is cleaned up, its sessions break off, and only what is on its disk remains.
"""

from __future__ import annotations

import asyncio
import fcntl
import logging
import signal
import sqlite3
from argparse import ArgumentParser, Namespace
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from contextlib import suppress
from contextvars import ContextVar, copy_context
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from argosy.processes.process_table import Process
from argosy.processes.supervisor import Child, Supervisor
from argosy.trial.event_loop import Datagrams
from argosy.trial.network import Network
from bridged.simulation.command import VEHICLES
from commd.process.process import EXIT_BAD_INPUT, EXIT_FAILED
from schemas.files.findings import Findings
from schemas.mission.model import Mission, load_mission
from schemas.wire.log_lines import Level, LogLine, encode

PRESENT: ContextVar[VirtualProcess | None] = ContextVar("PRESENT", default=None)
"""The process that runs now; None: the run itself."""
FIRST_PID: Final = 1 << 30
"""Above every real process id: nothing can be sent to another process by mistake."""
START: Final = 0.3
"""Virtual seconds from the start of a process to its first line: of the interpreter and the imports of a daemon, whose
byte code is there (docs/measurements/benchmarks.md, Start)."""
SIMULATED: Final = tuple(VEHICLES)
"""Vehicles of `bridged simulate` that a trial has in virtual time."""
_LEVELS: Final[dict[str, Level]] = {"CRITICAL": "error", "ERROR": "error", "WARNING": "warning"}
_DAEMONS: Final = {"commd": "commd.daemon", "bridged": "bridged.daemon", "agentd": "agentd.daemon"}


@dataclass
class Machine:
    """A board, as its processes see it; times are virtual."""

    board: str
    down_until: float = 0.0
    full_until: float = 0.0
    boots: int = 0
    """How often its power has failed."""
    booted: float = 0.0
    """When it was started last."""
    ahead: float = 0.0
    """Seconds by which its wall clock is wrong."""


class VirtualProcess:
    """A process of the trial, with what `Child` uses of `asyncio.subprocess.Process`."""

    def __init__(self, network: Network, pid: int, argv: Sequence[str], machine: Machine | None = None) -> None:
        """`argv`: `MODULE COMMAND ARGUMENT...`. `machine`: on which it runs."""
        self.machine = machine or Machine("local")
        self.network, self.pid, self.argv = network, pid, tuple(argv)
        self.returncode: int | None = None
        self.dead = False
        """Whether nothing of it may run any more."""
        self.handlers: dict[int, Callable[[], object]] = {}
        """What it does on a signal."""
        self.locks: list[int] = []
        """File descriptors that it has locked."""
        self.sockets: list[Datagrams] = []
        """Its UDP sockets."""
        self.files: list[tuple[Path, sqlite3.Connection]] = []
        """Databases that it has opened, each with its file."""
        self.stdout, self.stderr = asyncio.StreamReader(), asyncio.StreamReader()
        self._ended = asyncio.Event()
        self._context = copy_context()
        self._context.run(PRESENT.set, self)
        self._kept = asyncio.get_running_loop().create_task(self._run(), context=self._context)

    async def _run(self) -> None:
        await asyncio.sleep(START)
        try:
            code = await main_of(self.argv)
        except Findings as findings:
            self.write(LogLine(text=str(findings), level="error"))
            code = EXIT_BAD_INPUT
        except Exception as error:
            self.write(LogLine(text=f"{type(error).__name__}: {error}", level="error"))
            code = EXIT_FAILED
        self._end(code)

    def write(self, line: LogLine) -> None:
        """Write a line to its standard error."""
        if not self.dead:
            self.stderr.feed_data(encode(line) + b"\n")

    def send_signal(self, number: int) -> None:
        """Call the handler of a signal, or end the process."""
        if self.dead:
            raise ProcessLookupError
        if (handler := self.handlers.get(number)) is not None and number != signal.SIGKILL:
            self._context.copy().run(handler)
        else:
            self._end(-number)

    def _end(self, code: int) -> None:
        if self.dead:
            return
        self.dead, self.returncode = True, code
        self.network.left.append(asyncio.all_tasks(self.network.loop))
        for session in [one for one in self.network.sessions if one.owner is self]:
            self.network.close(session)
        for socket in self.sockets:
            socket.free()
        for descriptor in self.locks:
            with suppress(OSError):  # it has closed the file itself
                fcntl.flock(descriptor, fcntl.LOCK_UN)
        self._break_off_files()
        for stream in (self.stdout, self.stderr):
            stream.feed_eof()
        self._ended.set()

    def _break_off_files(self) -> None:
        """Leave its databases as a process does that is killed: SQLite moves a log into its file where it is closed."""
        named = [name for path, _ in self.files for name in (path, path.with_name(f"{path.name}-wal"))]
        left = {name: name.read_bytes() for name in named if name.exists()}
        for _, file in self.files:
            with suppress(sqlite3.Error):  # what it had not committed is lost
                sqlite3.Connection.close(file)
        for name, content in left.items():
            if not name.exists() or name.read_bytes() != content:
                name.write_bytes(content)

    async def wait(self) -> int:
        """Wait for its end; return its exit code, or minus the signal that has killed it."""
        await self._ended.wait()
        assert self.returncode is not None
        return self.returncode


def main_of(argv: Sequence[str]) -> Coroutine[Any, Any, int]:
    """Return the main coroutine of a command: of a daemon's `serve`, or of a simulator."""
    module, command, *rest = argv
    if command == "serve":
        daemon = import_module(_DAEMONS[module])
        return _serve(daemon, _parsed(daemon, rest))
    vehicle, *rest = rest
    if (module, command) != ("bridged", "simulate") or vehicle not in SIMULATED:
        raise ValueError(f"{' '.join(argv[:3])} cannot run in a trial")
    simulator = import_module(VEHICLES[vehicle][0])
    args = _parsed(simulator, rest)
    args.vehicle = vehicle
    return _simulate(simulator, args)


def _parsed(module: Any, words: Sequence[str]) -> Namespace:
    parser = ArgumentParser()
    module.add_arguments(parser)
    return parser.parse_args(words)


@cache
def read_once(mission: str) -> Mission:
    """Read a mission file, which no process changes. Raises Findings."""
    return load_mission(mission)


async def _serve(daemon: Any, args: Namespace) -> int:
    return int(await daemon.serve(read_once(args.mission), args, _stop()))


async def _simulate(simulator: Any, args: Namespace) -> int:
    await simulator.simulation(args, _stop())
    return 0


def _stop() -> asyncio.Event:
    """Return an event that SIGTERM sets."""
    stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    return stop


class ProcessLog(logging.Handler):
    """Writes log records to the process that logs them, as its log handler does."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record."""
        if (process := PRESENT.get()) is not None:
            level = _LEVELS.get(record.levelname, "info")
            process.write(LogLine(text=record.getMessage(), level=level, event=getattr(record, "event", None)))


class VirtualChild(Child):
    """A started process of a trial."""

    stopped = False  # no signal of a trial stops one

    def kill_group(self) -> None:
        """Do nothing: no process of a trial starts others."""


class VirtualSupervisor(Supervisor):
    """Starts the processes of a run in this one."""

    network: Network
    ready: Callable[[str], Awaitable[None]]
    """Waits until a board can start processes."""
    machine: Callable[[str], Machine]
    """Return the machine of a board."""

    async def launch(self, process: Process) -> Child:
        """Start a process, when its board is there."""
        await self.ready(process.board)
        arguments = process.argv[process.argv.index("-m") + 1 :]
        pid = FIRST_PID + next(self.network.numbers)
        started = VirtualProcess(self.network, pid, arguments, self.machine(process.board))
        return VirtualChild(process, started)  # type: ignore[arg-type]
