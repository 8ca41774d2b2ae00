"""Agents in tests as a daemon hosts them: on a real bus, kept in a real checkpoint whose disk the test can hold up."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.mail.neighbours import Neighbours
from agentd.mind.data.effects import TeamRequest
from agentd.mind.data.inputs import Mail, TeamReply
from agentd.persistence.checkpoint import AgentRows, Checkpoint, CheckpointError
from agentd.persistence.group_commit import GroupCommit
from agentd.persistence.restore import RestoredState, open_state
from agentd.runtime.agent_directory import AgentDirectory
from agentd.runtime.agent_host import AgentHost
from agentd.runtime.program_loader import Part
from agentd.trace.initial_state import Sources
from agentd.trace.publisher import TraceSubscribers
from commd.bus.bus import Bus
from commd.client.manual_percepts import HandPerceptSubscription
from commd.common.clock import Clock
from tests.support.buses import Connect


class Disk:
    """Stands before a checkpoint: what is saved waits, or fails, as the test says."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.savings: list[AgentRows] = []
        """What was saved of each agent, in order."""
        self.soft: list[bool] = []
        """Which of the commits need not survive a power cut."""
        self.open = threading.Event()
        self.open.set()
        self.full = ""
        self.notes, self.path = checkpoint.notes, checkpoint.path
        self._checkpoint = checkpoint

    def save(self, savings: Mapping[str, AgentRows], soft: bool) -> None:
        if not self.open.wait(240):
            raise AssertionError("the disk was held up for too long")
        if self.full:
            raise CheckpointError(self.full)
        self._checkpoint.save(savings, soft)
        self.savings.extend(savings.values())
        self.soft.append(soft)

    def shorten_log(self) -> None:
        self._checkpoint.shorten_log()

    def close(self) -> None:
        self._checkpoint.close()


class Hosts:
    """A daemon's agents in a test: their checkpoint, its writer, and the mail between them."""

    def __init__(self, checkpoint: Checkpoint, states: dict[str, RestoredState]) -> None:
        self.states = states
        self.disk = Disk(checkpoint)
        self.writer = ThreadPoolExecutor(1)
        self.commits = GroupCommit(cast(Checkpoint, self.disk), self.writer)
        self.neighbours = Neighbours()
        self.closed = False

    @classmethod
    async def open(cls, folder: Path, *agents: str) -> Hosts:
        """Open the checkpoint of these agents in a folder."""
        checkpoint, states = await asyncio.to_thread(open_state, folder, agents[0], agents, (), "FULL")
        assert checkpoint is not None
        return cls(checkpoint, states)

    async def close(self) -> None:
        if not self.closed:
            self.closed = True
            await self.commits.close()
            self.writer.shutdown()


class Hosted:
    """One life of an agent."""

    def __init__(self, host: AgentHost, daemon: Hosts) -> None:
        self.host, self.daemon, self.disk = host, daemon, daemon.disk
        self._stop = asyncio.Event()
        self._life: asyncio.Task[None] | None = None
        self._over = False

    def begin(self) -> None:
        """Let it reason."""
        self._life = asyncio.create_task(self.host.run(self._stop))

    @property
    def prints(self) -> list[str]:
        return list(self.host.viewer.view().prints)

    @property
    def beliefs(self) -> tuple[str, ...]:
        return tuple(one.text for one in self.host.viewer.view().beliefs)

    def tell(self, mail: Mail) -> None:
        """Hand it a message that does not come by the bus."""
        self.host._mailing.tell(mail)

    async def leave(self) -> None:
        """Let it leave in order, while its daemon goes on."""
        if self._over:
            return
        self._over = True
        self.disk.open.set()
        self._stop.set()
        if self._life is not None:
            await self._life
        self.host.close()

    async def end(self) -> None:
        """Let it leave in order, and end its daemon."""
        await self.leave()
        await self.daemon.close()

    async def die(self) -> None:
        """End it as a kill does: nothing is saved that is not on disk."""
        self._over = True
        self.disk.full = "the process is dead"
        self._stop.set()
        if self._life is not None:
            self._life.cancel()
            await asyncio.gather(self._life, return_exceptions=True)
        await self.daemon.close()
        self.host.close()


async def host_on(
    bus: Bus,
    name: str,
    source: str,
    folder: Path,
    *,
    others: tuple[str, ...] = (),
    daemon: Hosts | None = None,
    begins: bool = True,
    **part: Any,
) -> Hosted:
    """Begin a life of an agent that is kept in a folder; the names of `others` are known to it.

    Without `daemon` it is alone in its daemon. Unless it `begins`, it reasons when the test says so.
    """
    daemon = daemon or await Hosts.open(folder, name)
    program = compile_program(parse_program(source, f"{name}.asl"))
    directory = cast(
        AgentDirectory,
        SimpleNamespace(
            names=dict.fromkeys((name, *others), "board"), met=lambda name: None, remember=lambda names: None
        ),
    )
    sources = Sources(main=f"{name}.asl")
    sources.keep(sources.main, source)
    made = Part(name=name, program=program, **{"sources": sources, **part})
    token = bus.token(f"test/{name}/{bus.boot}")
    shared = TraceSubscribers(bus), HandPerceptSubscription(bus), daemon.commits, daemon.neighbours
    host = AgentHost(bus, Clock(), made, directory, NoTeam(), token, *shared, daemon.states.get(name))
    hosted = Hosted(host, daemon)
    if begins:
        hosted.begin()
    return hosted


class Board:
    """The agents of a test on one bus, kept in one folder; those that are there at its end leave in order."""

    def __init__(self, connect: Connect, folder: Path) -> None:
        self.connect, self.folder = connect, folder
        self._hosted: list[Hosted] = []

    async def host(self, name: str, source: str, *, bus: Bus | None = None, **options: Any) -> Hosted:
        """Begin a life of an agent; see `host_on`."""
        hosted = await host_on(bus or await self.connect(name), name, source, self.folder, **options)
        self._hosted.append(hosted)
        return hosted

    async def close(self) -> None:
        for hosted in self._hosted:
            await hosted.leave()
        for hosted in self._hosted:
            await hosted.daemon.close()


@asynccontextmanager
async def on_a_board(connect: AbstractAsyncContextManager[Connect], folder: Path) -> AsyncIterator[Board]:
    """Yield a board whose `host` begins agents; they end with it."""
    async with connect as opens:
        board = Board(opens, folder)
        yield board
        await board.close()


class NoTeam:
    async def answer(self, host: AgentHost, request: TeamRequest) -> TeamReply:
        return TeamReply(request.id, None, "unknown", "there is no team")
