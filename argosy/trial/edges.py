"""What a trial swaps: the edges of the product. Everything between them is the code that daemons run.

`Authority.take_over` comes before the product is imported, `swap_bus` after it.

| edge | in a trial |
|---|---|
| clocks of `time`, local time | the virtual time of the loop, in UTC, by the clock of each board |
| `os.urandom`, `random.SystemRandom` and `secrets`, which use it, `random` | generators seeded by the trial |
| executors | work in the thread of the loop |
| sessions of `commd.bus` | those of the virtual network (`bus_edges`) |
| signals, UDP | `argosy.trial.event_loop` |
| locks and SQLite files | belong to the process of the trial that opened them, and end with it |
| boots of the machine | those of its board |
| processes | `argosy.trial.process` |
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import fcntl
import json
import os
import random
import resource
import sqlite3
import sys
import threading
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Final

from argosy.trial.event_loop import VirtualLoop

if TYPE_CHECKING:  # the product is imported when its edges are swapped
    from argosy.trial.network import Network, Session

EPOCH: Final = 1_700_000_000.0
"""Unix time at which each trial begins."""


class InlineExecutor(concurrent.futures.Executor):
    """Works immediately, in the thread that asks."""

    def __init__(self, *_: Any, **__: Any) -> None:
        super().__init__()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        """Call a function and return its future, which is done."""
        done: concurrent.futures.Future[Any] = concurrent.futures.Future()
        try:
            done.set_result(fn(*args, **kwargs))
        except Exception as error:
            done.set_exception(error)
        return done

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Do nothing: nothing waits."""


class _NoThread:
    def __init__(self, **_: Any) -> None:
        pass

    def start(self) -> None:
        """Do nothing: what it would do is done in the thread of the loop."""

    def join(self, timeout: float | None = None) -> None:
        """Do nothing."""


class _Notifying(SimpleQueue[Any]):
    """A queue that calls `added()` after each `put`."""

    def __init__(self, added: Callable[[], object]) -> None:
        self._added = added

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        super().put(item)
        self._added()


class Authority:
    """Who hands out time and chance in this process; the loop and the seed are those of the present run."""

    machine: Callable[[], Any] = staticmethod(lambda: SimpleNamespace(ahead=0.0, booted=0.0))
    """Return the machine of the process that runs now (`argosy.trial.process.Machine`)."""

    def __init__(self) -> None:
        self.loop = VirtualLoop()
        self.chance = random.Random(0)

    def begin(self, seed: int) -> VirtualLoop:
        """Begin a run: its time is 0, and its chance that of its seed."""
        self.chance = random.Random(f"argosy trial {seed}")
        random.seed(seed)
        asyncio.set_event_loop(self.loop)
        return self.loop

    def now(self) -> float:
        """Return virtual seconds since the start of the run."""
        return self.loop.time()

    def take_over(self) -> None:
        """Become the authority of this process. Call it before the product is imported."""
        time.monotonic = self.loop.time
        time.monotonic_ns = lambda: int(self.now() * 1e9)
        time.time = lambda: EPOCH + self.now() + self.machine().ahead
        time.time_ns = lambda: int(EPOCH * 1e9) + int((self.now() + self.machine().ahead) * 1e9)
        time.clock_gettime = lambda clock: self.now() - self.machine().booted
        time.perf_counter, time.perf_counter_ns = time.monotonic, time.monotonic_ns
        time.process_time = time.thread_time = lambda: 0.0
        in_utc = time.gmtime
        time.localtime = time.gmtime = lambda seconds=None: in_utc(time.time() if seconds is None else seconds)
        time.sleep = _never  # type: ignore[assignment]
        resource.getrusage = _no_use
        os.urandom = random._urandom = lambda size: self.chance.randbytes(size)  # type: ignore[attr-defined]
        concurrent.futures.ThreadPoolExecutor = InlineExecutor  # type: ignore[assignment, misc]


def _no_use(who: int) -> resource.struct_rusage:
    """Return that nothing was used. (CPython 3.11 reports an error if such an object outlives its type at the end.)"""
    return resource.struct_rusage([0.0] * 16)


def _never(seconds: float) -> None:
    raise RuntimeError("nothing may sleep in a trial but by the event loop")


def bus_edges(network: Network) -> dict[str, Callable[..., Awaitable[Any]]]:
    """Return what takes the place of functions of `commd.bus`, by their names: its sessions are those of a network."""
    from argosy.trial.process import PRESENT

    async def open_session(config: Any, endpoint: str, stop: asyncio.Event | None = None) -> Session:
        name = json.loads(config.get_json("metadata"))["name"]
        return network.open(endpoint, name, json.loads(config.get_json("mode")) == "router", PRESENT.get())

    async def close_session(closing: Session) -> bool:
        closing.close()
        return True

    async def why_not(endpoint: str, tls: Any) -> str:
        return "Connection refused"

    return {
        "commd.bus.session.open_session": open_session,
        "commd.bus.bus.open_session": open_session,
        "commd.bus.bus.close_session": close_session,
        "commd.bus.session.why_not": why_not,  # it would try a real connection, in a thread
    }


def swap_bus(loop: VirtualLoop) -> Any:
    """Give the product's bus a virtual network, its processes their output, and return the network."""
    from agentd.persistence import poison_inputs
    from argosy.trial.network import Network
    from argosy.trial.power_loss import Disk, replaced, synced
    from argosy.trial.process import PRESENT, Machine
    from commd.mail import store
    from commd.process import output, restart_counter
    from schemas.wire.log_lines import LogLine

    network = Network(loop)
    os.getpid = lambda: 0 if (present := PRESENT.get()) is None else present.pid

    for name, replacement in bus_edges(network).items():
        module, _, function = name.rpartition(".")
        setattr(sys.modules[module], function, replacement)
    lock = fcntl.flock

    def flock(file: Any, operation: int) -> None:
        lock(file, operation)
        if (present := PRESENT.get()) is not None and operation & fcntl.LOCK_EX:
            present.locks.append(file if isinstance(file, int) else file.fileno())

    fcntl.flock = flock
    os.fsync, os.replace = synced, replaced  # type: ignore[assignment]
    connect = sqlite3.connect

    def connected(*args: Any, **options: Any) -> sqlite3.Connection:
        made: Disk = connect(*args, factory=Disk, **options)
        made.at(Path(args[0]))
        if (present := PRESENT.get()) is not None:
            board = present.machine
            made.full = lambda: loop.time() < board.full_until
            present.files.append((Path(args[0]), made))
        return made

    sqlite3.connect = connected  # type: ignore[assignment]

    class InlineStore(store.Store):
        """Writes in the thread of the loop."""

        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            self._writer = _NoThread()  # type: ignore[assignment]
            self._waiting = _Notifying(lambda: loop.call_soon(self._write_now))

        def _write_now(self) -> None:
            if self._closing:
                self._work()
            elif not self._waiting.empty():
                self._write_group()

    store.Store = InlineStore  # type: ignore[misc]

    def write(
        self: Any, text: str, priority: int = output.INFORMATIONAL, *, agent: str = "", event: Any = None
    ) -> None:
        if (present := PRESENT.get()) is not None:
            for line in text.split("\n"):
                present.write(LogLine(text=line, level=output._LEVELS.get(priority, "info"), agent=agent, event=event))

    output.Output.write = write  # type: ignore[method-assign]
    output.threading = SimpleNamespace(Thread=_NoThread, Event=threading.Event)  # type: ignore[assignment, attr-defined]
    poison_inputs._watch = lambda one: None
    operator = Machine("operator")

    def machine() -> Machine:
        return operator if (present := PRESENT.get()) is None else present.machine

    Authority.machine = staticmethod(machine)
    boot = SimpleNamespace(read_text=lambda: f"{machine().board} {machine().boots}")
    restart_counter._BOOT = boot  # type: ignore[assignment]

    loop.owner = PRESENT
    return network
