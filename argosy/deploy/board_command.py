"""`argosy board`: commd, bridged and agentd of one board in one process and one event loop, to save memory.

Code, names, tokens and keys on the bus are those of the three daemons. A failure of one part ends the whole process.
"""

from __future__ import annotations

import asyncio
import logging
from argparse import ArgumentParser, Namespace
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import agentd.daemon
import bridged.daemon
import commd.daemon
from agentd.extensions.plugins import discover
from agentd.process import allow_deep_calls
from commd.bus.errors import AlreadyRunning, BusClosed
from commd.process.garbage import look_seldom
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE, EXIT_FAILED, run_daemon
from commd.process.systemd import Member, Unit
from commd.router import config
from commd.router.tls_rejections import hear_refusals
from schemas.files.findings import Findings
from schemas.mission.model import Mission, load_mission

LEAVE = 60.0
"""Wall seconds for the parts to end: a bridge may try three orders of 10 s each to make its robot safe."""
LOOK = 0.05
"""Wall seconds between two checks whether the router serves."""
log = logging.getLogger("board")

Serve = Callable[[Mission, Namespace, asyncio.Event, Member], Awaitable[int]]


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy board`: the mission, and every option that one of the three daemons takes."""
    parser.add_argument("mission", help="mission file")
    state = "folder of mail, checkpoints and action log, below the fleet's name"
    parser.add_argument("--state", type=Path, metavar="DIR", help=state)
    gathered = _Options()
    for daemon in (commd.daemon, bridged.daemon, agentd.daemon):
        daemon.add_arguments(gathered)
    for names, settings in gathered.options.values():
        if "--state" not in names:
            parser.add_argument(*names, **settings)


class _Options(ArgumentParser):
    """Collects the options of several daemons; an option of two daemons has one meaning."""

    def __init__(self) -> None:
        self.options: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {}
        super().__init__(add_help=False)

    def add_argument(self, *names: str, **settings: Any) -> Any:
        if names[0].startswith("-"):
            self.options.setdefault(names[0], (names, settings))


def run(args: Namespace) -> int:
    """Run the board until a signal, or until a part fails. Returns the exit code."""
    allow_deep_calls()
    discover()
    if args.keys is not None or args.config is not None:
        hear_refusals()

    async def main(stop: asyncio.Event) -> int:
        look_seldom()
        return await serve(load_mission(args.mission), args, stop)

    return run_daemon("board", main)


async def serve(mission: Mission, args: Namespace, stop: asyncio.Event) -> int:
    """Run the parts of this board, the router first. The service manager sees one unit."""
    board = commd.daemon.chosen(mission, args.board)
    given = Namespace(**{**vars(args), "board": board, "robots": [], "agents": []})
    if given.config is not None and given.router is None:  # agents and bridges use the router's own socket
        given.router = config.read(given.config).listen[0]
    daemons: dict[str, Serve] = {"commd": commd.daemon.serve}
    if mission.robots_on(board):
        daemons["bridged"] = bridged.daemon.serve
    if mission.agents_on(board):
        daemons["agentd"] = agentd.daemon.serve
    parts = Parts(mission, given, daemons, Unit())
    log.info("board=%s in one process: %s", board, ", ".join(daemons))
    return await parts.run(stop)


class Parts:
    """The daemons of a board, each a task with its own stop event."""

    def __init__(self, mission: Mission, args: Namespace, daemons: Mapping[str, Serve], unit: Unit) -> None:
        """`daemons`: the `serve` of each part, `commd` first."""
        self._mission, self._args, self._daemons = mission, args, daemons
        self.members = {name: unit.member(name) for name in daemons}
        self._stops = {name: asyncio.Event() for name in daemons}
        self._running: dict[asyncio.Task[int], str] = {}
        self._code = EXIT_DONE

    async def run(self, stop: asyncio.Event) -> int:
        """Run until `stop` or a failure, end every part, and return the exit code.

        Bridge and agents end together, then the router: a vehicle in flight does not wait for the agents.
        """
        router, *others = self._daemons
        ending = asyncio.create_task(stop.wait())
        self._start(router)
        while not self.members[router].is_ready and self._goes_on(ending):
            await asyncio.wait((ending, *self._running), timeout=LOOK, return_when=asyncio.FIRST_COMPLETED)
            self._look(ending.done())
        for name in others if self._goes_on(ending) else ():
            self._start(name)
        while self._goes_on(ending):
            await asyncio.wait((ending, *self._running), return_when=asyncio.FIRST_COMPLETED)
            self._look(ending.done())
        ending.cancel()
        await self._end(others)
        await self._end([router])
        return self._code

    def _start(self, name: str) -> None:
        async def live() -> int:
            return await self._daemons[name](self._mission, self._args, self._stops[name], self.members[name])

        self._running[asyncio.create_task(live(), name=name)] = name

    def _goes_on(self, ending: asyncio.Task[Literal[True]]) -> bool:
        return bool(self._running) and not ending.done() and self._code == EXIT_DONE

    def _look(self, ending: bool) -> None:
        """Handle parts that have ended. Agents may end by `.stopMAS`; the others only on request."""
        for task in [task for task in self._running if task.done()]:
            name = self._running.pop(task)
            code, why = _outcome(task)
            if code == EXIT_DONE and not ending and name == "agentd":
                log.info("agentd has ended: a program has stopped its team; the board goes on without agents")
                continue
            if code == EXIT_DONE and not ending and not self._stops[name].is_set():
                code, why = EXIT_FAILED, "it ended by itself"
            if code != EXIT_DONE:
                log.error("%s has failed, the board ends: %s", name, why)
                self._code = self._code or (EXIT_BAD_INPUT if code == EXIT_BAD_INPUT else EXIT_FAILED)

    async def _end(self, names: list[str]) -> None:
        """Stop parts and wait for them, at most `LEAVE` seconds."""
        for name in names:
            self._stops[name].set()
        if leaving := [task for task, name in self._running.items() if name in names]:
            _, late = await asyncio.wait(leaving, timeout=LEAVE)
            self._look(True)
            for task in late:
                log.error("%s did not end within %g s", self._running.pop(task), LEAVE)
                self._code = self._code or EXIT_FAILED


def _outcome(task: asyncio.Task[int]) -> tuple[int, str]:
    """Return the exit code of a part that has ended, and why."""
    if task.cancelled():
        return EXIT_FAILED, "it was cancelled"
    match task.exception():
        case None:
            return task.result(), f"exit code {task.result()}"
        case Findings() as findings:
            return EXIT_BAD_INPUT, str(findings)
        case AlreadyRunning() | BusClosed() as error:
            return EXIT_FAILED, str(error)
        case error:
            return EXIT_FAILED, f"defect in argosy: {type(error).__name__}: {error}"
