"""Run boards of a benchmark on one machine, a commd each, and members that post and take mail as daemons do."""

from __future__ import annotations

import asyncio
import os
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from typing import Final, Literal

from benchmarks import processes
from benchmarks.processes import SPEAKS, BenchmarkFailed, Watched, watched
from commd.bus.bus import Bus, Query, Token, boot_id, open_bus
from schemas.wire import keys
from schemas.wire.records import Header, Mail, Message, Receipt
from schemas.wire.term_text import read
from schemas.wire.terms import Term
from tests.support.ports import free_port

FLEET: Final = "bench"
Synchronous = Literal["full", "normal"]
"""How SQLite writes mail."""
PATIENCE: Final = 30.0
"""Seconds for one batch to be taken."""
_CONTENT: Final = 'item(17, "some text", [1.5, 2.5])'
_MISSION: Final = """\
mission: {fleet}
boards: {{{boards}}}
agents:
{agents}
clients: {{{probe}: {{board: {first}}}}}
mail: {{synchronous: {synchronous}, mailbox: 1000000}}
"""
PROBE: Final = "probe"
"""The client of the first board that may post."""


class Boards:
    """Boards whose routers know one another, each with its own state folder."""

    def __init__(
        self,
        stack: ExitStack,
        folder: Path,
        agents: Mapping[str, str],
        synchronous: Synchronous,
        programs: Mapping[str, str],
    ) -> None:
        self._stack, self._folder = stack, folder
        names = list(dict.fromkeys(agents.values()))
        self.endpoints = {name: f"tcp/127.0.0.1:{free_port()}" for name in names}
        self._between = {name: f"tcp/127.0.0.1:{free_port()}" for name in names}
        self.daemons: dict[str, Watched] = {}
        entries = [
            f"  {agent}: {{{programs.get(agent, 'program: none.asl')}, board: {board}}}"
            for agent, board in agents.items()
        ]
        self._mission = folder / "bench.yaml"
        self._mission.write_text(
            _MISSION.format(
                fleet=FLEET,
                boards=", ".join(f"{name}: {{}}" for name in names),
                agents="\n".join(entries),
                probe=PROBE,
                first=names[0],
                synchronous=synchronous,
            )
        )

    def start(self, name: str) -> Watched:
        """Start the commd of a board, and wait until it serves."""
        others = [f"--connect={end}" for other, end in self._between.items() if other < name]
        self.daemons[name] = self._run("commd", name, "router board=", SPEAKS, "--listen", self._between[name], *others)
        return self.daemons[name]

    def think(self, name: str, patience: float = SPEAKS) -> Watched:
        """Start the agentd of a board, and wait until it serves, for at most `patience` seconds."""
        return self._run("agentd", name, "agents=", patience)

    def _run(self, daemon: str, board: str, ready: str, patience: float, *more: str) -> Watched:
        where = (
            "--board",
            board,
            "--router",
            self.endpoints[board],
            "--state",
            str(self._folder / f"{daemon}-{board}"),
        )
        command = ("-m", daemon, "serve", str(self._mission), *where, *more)
        found = self._stack.enter_context(watched(f"{daemon} of {board}", *command))
        found.wait_for(ready, patience)
        return found


@contextmanager
def boards(
    folder: Path,
    agents: Mapping[str, str],
    synchronous: Synchronous,
    *,
    start: bool = True,
    programs: Mapping[str, str] | None = None,
) -> Iterator[Boards]:
    """Boards for these agents (agent to board); all processes end with the block.

    `programs`: the entries of agents with a mind in the mission, as `program: a.asl`, by agent.
    """
    with ExitStack() as stack:
        made = Boards(stack, folder, agents, synchronous, programs or {})
        for name in made.endpoints if start else ():
            made.start(name)
        yield made


class Member:
    """Somebody with a mailbox: posts batches to the outbox of its board, and takes what comes to its inbox."""

    def __init__(self, bus: Bus, name: str) -> None:
        self.name = name
        self.came: Counter[str] = Counter()
        """Messages taken, by sender; each was the next of its sender, or the benchmark fails."""
        self.on_message: Callable[[Message, float], None] = lambda message, now: None
        self._bus, self._numbering, self._posted = bus, boot_id(), Counter[str]()
        self._token: Token | None = None

    def open(self) -> None:
        """Be there: take what comes from now on."""
        self._bus.serve(keys.inbox(FLEET, self.name), Mail, self._take)
        self._token = self._bus.token(keys.alive(FLEET, self.name, "agentd", self._bus.boot))

    async def post(self, receivers: Sequence[str], content: str = _CONTENT) -> float:
        """Post one message to each of the receivers named, in one batch. Returns the seconds until it was on disk."""
        term = read(content)
        batch = Mail(messages=tuple(self._message(receiver, term) for receiver in receivers))
        begun = time.monotonic()
        while time.monotonic() < begun + PATIENCE:
            async for reply in self._bus.query(keys.outbox(FLEET, self.name), batch, Receipt, PATIENCE):
                receipt = reply.record
                if receipt is not None and receipt.taken == len(batch.messages):
                    return time.monotonic() - begun
                if receipt is not None and receipt.refused:
                    raise BenchmarkFailed(f"refused: {receipt}")
            await asyncio.sleep(0.05)
        raise BenchmarkFailed(f"{len(batch.messages)} messages of {self.name} were not taken in {PATIENCE:g} s")

    def _message(self, receiver: str, content: Term) -> Message:
        self._posted[receiver] += 1
        number = self._posted[receiver]
        header = Header(seq=number, boot=self._numbering)
        identity = f"{self.name}-{receiver}-{number}"
        return Message(
            header=header, id=identity, sender=self.name, performative="tell", receiver=receiver, content=content
        )

    async def _take(self, query: Query[Mail]) -> None:
        now = time.monotonic()
        if query.record is None:
            query.reply_error(query.error)
            return
        for message in query.record.messages:
            if message.header.seq == self.came[message.sender] + 1:
                self.came[message.sender] += 1
                self.on_message(message, now)
            elif message.header.seq > self.came[message.sender]:
                raise BenchmarkFailed(f"{message.id} came after {self.came[message.sender]}")
        query.reply(Receipt(taken=len(query.record.messages)))


@asynccontextmanager
async def member(endpoint: str, name: str) -> AsyncIterator[Member]:
    """A member with a session of its own at its board's router."""
    async with open_bus(endpoint, fleet=FLEET, name=name, daemon="agentd", patience=20) as bus:
        yield Member(bus, name)


async def until(condition: Callable[[], bool], wish: str, seconds: float, every: float = 0.005) -> None:
    """Wait until something holds. Raises BenchmarkFailed after a bound."""
    if not await asyncio.to_thread(processes.until, condition, seconds, every):
        raise BenchmarkFailed(f"not within {seconds:g} s: {wish}")


WRITES: Final = 50


def fsync() -> float:
    """Return the milliseconds that a commit costs here at least: the median of writing a page (4 kB) and fsync."""
    with tempfile.NamedTemporaryFile() as file:
        values = []
        for _ in range(WRITES):
            begun = time.perf_counter()
            os.pwrite(file.fileno(), bytes(4096), 0)
            os.fsync(file.fileno())
            values.append(time.perf_counter() - begun)
    return 1000 * statistics.median(values)
