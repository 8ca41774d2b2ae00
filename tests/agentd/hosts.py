"""Agents in tests as a daemon hosts them: on a real bus, kept in a real checkpoint whose disk the test can hold up."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.mind.data.effects import TeamRequest
from agentd.mind.data.inputs import Mail, TeamReply
from agentd.persistence.checkpoint import Checkpoint, CheckpointError, Saving
from agentd.persistence.restore import RestoredState, open_memory
from agentd.runtime.agent_directory import AgentDirectory
from agentd.runtime.agent_host import AgentHost
from agentd.runtime.program_loader import Part
from agentd.trace.initial_state import Sources
from agentd.trace.subscribers import TraceSubscribers
from commd.bus.bus import Bus
from commd.common.clock import Clock


class Disk:
    """Stands before a checkpoint: what is saved waits, or fails, as the test says."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self.savings: list[Saving] = []
        """What was saved, in order."""
        self.open = threading.Event()
        self.open.set()
        self.full = ""
        self.notes, self.path = checkpoint.notes, checkpoint.path
        self._checkpoint = checkpoint

    def save(self, saving: Saving) -> None:
        if not self.open.wait(30):
            raise AssertionError("the disk was held up for too long")
        if self.full:
            raise CheckpointError(self.full)
        self._checkpoint.save(saving)
        self.savings.append(saving)

    def shrink(self) -> None:
        self._checkpoint.shrink()

    def close(self) -> None:
        self._checkpoint.close()

    def forget(self) -> None:
        self._checkpoint.forget()


class Hosted:
    """One life of an agent."""

    def __init__(self, host: AgentHost, memory: RestoredState) -> None:
        self.host = host
        self.disk = cast(Disk, memory.checkpoint)
        self._writer = memory.writer
        self._stop = asyncio.Event()
        self._life = asyncio.create_task(host.run(self._stop))

    @property
    def prints(self) -> list[str]:
        return list(self.host.view().prints)

    @property
    def beliefs(self) -> tuple[str, ...]:
        return self.host.view().beliefs

    def tell(self, mail: Mail) -> None:
        """Hand it a message that does not come by the bus."""
        self.host._mailing.tell(mail)

    async def end(self) -> None:
        """Let it leave in order."""
        self.disk.open.set()
        self._stop.set()
        await self._life
        await self.host.close_checkpoint(forget=False)
        self.host.close()
        self._writer.shutdown()

    async def die(self) -> None:
        """End it as a kill does: nothing is saved that is not on disk."""
        self.disk.full = "the process is dead"
        self._life.cancel()
        self._stop.set()
        await asyncio.gather(self._life, return_exceptions=True)
        await self.host.close_checkpoint(forget=False)
        self.host.close()
        self._writer.shutdown()


async def host_on(
    bus: Bus, name: str, source: str, folder: Path, *, others: tuple[str, ...] = (), **part: Any
) -> Hosted:
    """Begin a life of an agent that is kept in a folder; the names of `others` are known to it."""
    writer = ThreadPoolExecutor(1)
    memory = await open_memory(folder / name, name, writer, "full", fresh=False)
    memory.checkpoint = cast(Checkpoint, Disk(memory.checkpoint))
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
    host = AgentHost(
        bus, Clock(), made, directory, NoTeam(), bus.token(f"test/{name}/{bus.boot}"), TraceSubscribers(bus), memory
    )
    return Hosted(host, memory)


class NoTeam:
    async def answer(self, host: AgentHost, request: TeamRequest) -> TeamReply:
        return TeamReply(request.id, None, "unknown", "there is no team")
