"""A driver of one's own: a lamp that speaks lines of text over TCP, and its simulated twin (docs/guides/drivers.md).

The lamp tells `level 40` (percent) once a second, and answers `set 40` by `done` or `no REASON`.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterable, Mapping

from bridged.drivers.api import Driver, Execution, Outcome, Setup, Value
from bridged.drivers.simple import SimpleDriver
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.mission.model import Robot

PATIENCE, AGAIN = 5.0, 1.0
"""Seconds of silence after which the lamp is called again, and until then."""


def check_manifest(manifest: Manifest) -> Iterable[Finding]:
    for name, percept in manifest.percepts.items():
        if percept.source != "level":
            yield manifest.finding(f"percepts.{name}.source: a lamp tells `level`", "percepts", name, "source")
    for name, action in manifest.actions.items():
        if action.call != "set" or action.arity != 1:
            yield manifest.finding(f'actions.{name}: expected `call = "set"` and one parameter', "actions", name)


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    if not robot.link.startswith("tcp:") or not robot.link.rpartition(":")[2].isdecimal():
        yield "link", "a lamp needs the field `link`: tcp:HOST:PORT"


def make_driver(setup: Setup) -> Driver:
    return LampDriver(setup)


class LampDriver(SimpleDriver):
    def __init__(self, setup: Setup) -> None:
        super().__init__(setup)
        self._writer: asyncio.StreamWriter | None = None
        self._asked: deque[Execution] = deque()  # the lamp answers in order

    async def run(self) -> None:
        if not self.setup.simulated:
            _, host, port = self.setup.robot.link.split(":")
            await self._serve(host, int(port))
        async with await asyncio.start_server(TwinLamp().serve, "127.0.0.1", 0) as twin:
            await self._serve(*twin.sockets[0].getsockname())

    async def _serve(self, host: str, port: int) -> None:
        while True:
            why = "the lamp hung up"
            try:
                async with asyncio.timeout(PATIENCE):
                    reader, self._writer = await asyncio.open_connection(host, port)
                while line := await asyncio.wait_for(reader.readline(), PATIENCE):
                    self._heard(*line.decode().strip().partition(" ")[::2])
            except (OSError, ValueError) as error:  # not there, silent, or no text
                why = f"the lamp is not there: {error or 'it is silent'}"
            finally:
                if self._writer is not None:
                    self._writer.close()
                self._writer = None
            while self._asked:
                self._asked.popleft().end(Outcome("failed", why))
            await asyncio.sleep(AGAIN)

    def _heard(self, word: str, rest: str) -> None:
        if word == "level":
            self.report("level", {"percent": float(rest)})
        elif word in ("done", "no") and self._asked:
            self._asked.popleft().end(Outcome("succeeded" if word == "done" else "failed", rest))

    def perform(self, name: str, entry: ActionEntry, arguments: Mapping[str, Value]) -> Execution:
        execution = Execution(name, waits_for="the lamp's answer")
        if self._writer is None:
            execution.end(Outcome("failed", "the lamp is not connected"))
        else:
            self._asked.append(execution)
            self._writer.write(f"set {arguments[entry.params[0].name]}\n".encode())
        return execution


class TwinLamp:
    level = 0.0

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while not reader.at_eof():
            writer.write(f"level {self.level}\n".encode())
            try:
                wanted = float((await asyncio.wait_for(reader.readline(), 1)).split()[1])
            except (TimeoutError, IndexError):  # nobody asks now, or ever again
                continue
            self.level = wanted if wanted <= 100 else self.level
            writer.write(b"done\n" if wanted <= 100 else b"no I would melt\n")
        writer.close()
