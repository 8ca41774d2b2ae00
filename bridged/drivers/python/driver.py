"""The Python driver: functions of plug-ins as percepts and actions, each called in a thread of its own."""

from __future__ import annotations

import asyncio
import inspect
import logging
import math
from collections import Counter
from collections.abc import Generator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, cast

from bridged.drivers.api import Execution, Outcome, Setup, Value
from bridged.drivers.python.plugins import Function, Plugins, arguments_of, fields_in, misfits, names
from bridged.drivers.python.worker_threads import FunctionRun, Raised, Result, Returned, Worker, outcome_of
from bridged.drivers.simple import SimpleDriver
from schemas.files.findings import Findings
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.wire.records import Note

RATE = 1.0
"""Calls in a second of the mission of a percept's function for which the manifest has no `rate`."""
MAX_RATE = 500.0
"""Calls and readings of one function in a wall second, at most."""
BOUND = 5.0
"""Wall seconds that a call for a reading may take, if the percept has no `ttl`, until it counts as hanging."""
AGAIN = 1.0
"""Wall seconds until a generator that ended or raised is begun again."""
TICK, TICKS = 0.25, 4.0
"""Most wall seconds between two turns, and least turns in a mission second."""
CLOSING = 0.3
"""Wall seconds for closing a generator when its action or the bridge ends; after that it counts as hanging."""
Readings = Generator[Any, None, Any]
log = logging.getLogger("python")


class PythonDriver(SimpleDriver):
    """A `bridged.drivers.api.Driver`. It knows no orders itself: the manifest's `orders` are actions."""

    def __init__(self, setup: Setup) -> None:
        """Raises Findings for functions that this run, real or simulated, lacks."""
        super().__init__(setup)
        self._plugins = Plugins(simulated=setup.simulated)
        self._functions: dict[str, Function] = {}
        self._workers: dict[str, Worker] = {}
        self._calls: set[FunctionRun] = set()
        """Calls that have not returned, also of actions that are over."""
        self._unused: set[str] = set()
        """Functions that the manifest no longer names, and that still have a thread."""
        self._polls: dict[str, asyncio.Task[None]] = {}
        self._running = False
        self._counts = Counter(failed=0, late=0)
        self._failing: dict[str, str] = {}
        """Functions of percepts whose last call raised, and what."""
        self.adopt(setup.manifest)

    async def run(self) -> None:
        """Call the functions of percepts until cancelled."""
        clock = self.setup.clock
        pause = min(TICK, 1 / (TICKS * clock.speed))
        self._running = True
        self._renew_polls()
        try:
            while True:
                for call in self._calls:
                    call.look()
                self.setup.on_turn()
                self._close_unused()
                await asyncio.sleep(pause)
        finally:
            self._running = False
            await self._close()

    def adopt(self, manifest: Manifest) -> None:
        """Go on by another manifest. Raises Findings."""
        if findings := list(misfits(manifest, self._plugins.function)):
            raise Findings(findings)
        self.manifest = manifest
        self._functions = {name: self._plugins.function(name) for name in names(manifest)}
        for name in self._functions.keys() - self._workers.keys():
            self._workers[name] = Worker(name, self.setup.clock.wall)
        if self._running:
            self._renew_polls()

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        """Begin to call a function."""
        call = FunctionRun(name, entry.call)
        if refused := self.refuses(entry):
            call.end(refused)
            return call
        try:
            given = arguments_of(entry, arguments)
        except ValueError as error:
            call.end(Outcome("refused", str(error)))
            return call
        function = self._functions[entry.call]
        self._calls.add(call)
        self._workers[entry.call].begin(lambda: call.work(function, given), lambda result: self._returned(call, result))
        return call

    def refuses(self, entry: ActionEntry) -> Outcome | None:
        """Refuse an action whose function has not returned from its last call."""
        worker = self._workers[entry.call]
        if not worker.busy:
            return None
        return Outcome("refused", f"`{entry.call}` has not returned from its last call for {worker.busy:.1f} s", "busy")

    def stop(self, execution: Execution, outcome: Outcome, *, hold: bool) -> None:
        """End an execution: a generator is closed at its next `yield`, a function runs on, and is not called meanwhile.

        The manifest knows no `hold` here.
        """
        if isinstance(execution, FunctionRun) and execution in self._calls:
            execution.abandon()
            worker = self._workers[execution.function]
            worker.bound = worker.busy + CLOSING
        execution.end(outcome)

    @property
    def heard(self) -> bool:
        """Whether no function of its percepts raises or hangs."""
        return not self._failing and not any(self._workers[source].hangs for source in self._polls)

    def counters(self) -> dict[str, float]:
        """Figures for health."""
        workers = self._workers.values()
        return {
            "calls": sum(worker.calls for worker in workers),
            "calls_failed": self._counts["failed"],
            "calls_late": self._counts["late"],
            "calls_hanging": sum(worker.hangs for worker in workers),
        }

    def notes(self) -> list[Note]:
        """Return which functions hang, and which fail."""
        then = "and is not called until it does"
        hang = [
            Note(
                "function_hangs",
                f"`{worker.name}` hangs: it has not returned within {worker.bound:.1f} s, {then}",
                worker.name,
            )
            for worker in self._workers.values()
            if worker.hangs
        ]
        return hang + [Note("function_fails", f"`{name}` fails: {why}", name) for name, why in self._failing.items()]

    def _returned(self, call: FunctionRun, result: Result) -> None:
        """Take in the result of a call, for an action that waits for it or is over."""
        self._calls.discard(call)
        self._counts["failed"] += isinstance(result, Raised)
        if call.over:
            self._counts["late"] += 1
            return
        call.look()
        call.end(outcome_of(call.function, result))

    def _note(self, function: str, result: Result) -> None:
        """Count a failure of a percept's function, and log the first one."""
        if not isinstance(result, Raised):
            self._failing.pop(function, None)
            return
        self._counts["failed"] += 1
        if function not in self._failing:
            log.warning("robot=%s `%s` raised %s: %s", self.setup.name, function, result.kind, result.text)
        self._failing[function] = result.text

    def _renew_polls(self) -> None:
        """Poll what percepts name, and nothing else."""
        sources = {entry.source for entry in self.manifest.percepts.values()}
        for source in self._polls.keys() - sources:
            self._polls.pop(source).cancel()
        for source in sorted(sources - self._polls.keys()):
            self._polls[source] = asyncio.create_task(self._poll(source))

    async def _poll(self, source: str) -> None:
        """Call a function for a reading, again and again; one that returns a generator is followed to its end."""
        loop, worker = asyncio.get_running_loop(), self._workers[source]
        while True:
            began = loop.time()
            rates = [entry.rate for entry in self.manifest.percepts.values() if entry.source == source and entry.rate]
            result = await worker.call(partial(_read, self._functions[source]), self._ttl(source) or BOUND)
            self._note(source, result)
            pause = began + self.setup.clock.to_wall(1 / max(rates, default=RATE)) - loop.time()
            if isinstance(result, Returned) and inspect.isgenerator(result.value):
                await self._follow(source, worker, cast(Readings, result.value))
                pause = AGAIN
            elif isinstance(result, Returned):
                self._take(source, result.value)
            await asyncio.sleep(max(1 / MAX_RATE, pause))

    async def _follow(self, source: str, worker: Worker, generator: Readings) -> None:
        """Take each reading that a generator yields, until it ends or raises."""
        bound = self._ttl(source) or math.inf  # without a `ttl` it may wait for an event for ever
        try:
            while True:
                result = await worker.call(lambda: _next(generator), bound)
                if isinstance(result, Returned) and result.value is _END:
                    return
                self._note(source, result)
                if isinstance(result, Raised):
                    return
                self._take(source, result.value)
                await asyncio.sleep(1 / MAX_RATE)
        finally:
            if not worker.busy:
                worker.begin(generator.close, lambda result: None, CLOSING)

    def _take(self, source: str, fields: Mapping[str, object] | None) -> None:
        try:
            self.report(source, fields)
        except Exception as error:  # a value that nothing can be made of must not end its source
            what = {"message": f"a reading of {source}", "exception": error}
            asyncio.get_running_loop().call_exception_handler(what)

    def _ttl(self, source: str) -> float:
        """The shortest `ttl` of a source's percepts; 0 if none has one."""
        ttls = [entry.ttl for entry in self.manifest.percepts.values() if entry.source == source and entry.ttl]
        return min(ttls, default=0.0)

    def _close_unused(self) -> None:
        """End threads that are unused since the last look and idle: calls and closing generators may end first."""
        unused = self._workers.keys() - self._functions.keys()
        for name in unused & self._unused:
            if not self._workers[name].busy:
                self._workers.pop(name).close()
        self._unused = unused

    async def _close(self) -> None:
        """Let generators end in their threads; hanging calls are left to the end of the process."""
        for poll in self._polls.values():
            poll.cancel()
        await asyncio.gather(*self._polls.values(), return_exceptions=True)
        for call in self._calls:
            call.abandon()
        until = self.setup.clock.wall() + CLOSING
        for worker in self._workers.values():
            with suppress(TimeoutError):
                async with asyncio.timeout(max(0.0, until - self.setup.clock.wall())):
                    await worker.idle()
            worker.close()


_END = object()


def _next(generator: Readings) -> object:
    """Return the fields of a generator's next reading, in its thread."""
    try:
        return fields_in(next(generator))
    except StopIteration:
        return _END


def _read(function: Function) -> object:
    """Call a function in its thread. Returns the fields of its result; a generator as it is."""
    value = function()
    return value if inspect.isgenerator(value) else fields_in(value)
