"""What mail costs: messages a second over three boards, latency across two, a backlog, and the memory of its daemon.

Three `commd` run as on boards, with routers that know one another; the members that post and take are in this process,
without minds. All of them share this machine.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import Final, Literal, TypeVar

from benchmarks.disk import fsync
from benchmarks.mail.agents import presence, talk
from benchmarks.mail.boards import Member, boards, member, until
from benchmarks.mail.page import BATCH, FLYING, TRICKLE, Caught, Figures, Resident, blocks, goals, pictures
from benchmarks.parts import tell
from benchmarks.processes import BenchmarkFailed, memory
from benchmarks.serving import bare as bare_process
from benchmarks.spread import Spread, spread
from benchmarks.watched import watched
from schemas.wire.records import Message
from tests.support.ports import free_port

__all__ = ["Figures", "blocks", "goals", "measure", "pictures"]

Synchronous = Literal["full", "normal"]
T = TypeVar("T")

SECONDS: Final = 12.0
LETTERS: Final = 400
"""Single messages whose latency is measured."""
BACKLOG: Final = 36_000
"""An hour at 10 messages a second."""
QUEUED: Final = 100_000
SETTLE: Final = 3.0
"""Wall seconds until the memory of a daemon is looked at."""
TOKENS: Final = 1_000
_HAS: Final = ("asyncio", "msgspec", "sqlite3")
"""What commd has imported, and the bare process as well."""


async def throughput(folder: Path, synchronous: Synchronous, seconds: float) -> float:
    """Messages a second that arrive, summed over three boards each of which sends to both others."""
    names = {"ann": "b1", "bob": "b2", "cid": "b3"}
    with boards(folder, names, synchronous) as made:
        async with AsyncExitStack() as stack:
            members = [
                await stack.enter_async_context(member(made.endpoints[board], name)) for name, board in names.items()
            ]
            posted, counting = 0, False
            for one in members:
                one.open()

            def arrived() -> int:
                return sum(sum(one.came.values()) for one in members)

            async def keep_posting(one: Member) -> None:
                nonlocal posted
                others = [other for other in names if other != one.name]
                while not counting or time.monotonic() < end:
                    if posted - arrived() < FLYING:
                        posted += BATCH
                        await one.post(others * (BATCH // 2))
                    else:
                        await asyncio.sleep(0.002)

            end = float("inf")
            async with asyncio.TaskGroup() as tasks:
                for one in members:
                    tasks.create_task(keep_posting(one))
                await until(lambda: arrived() > FLYING, "mail flows", 60)
                begun, first = time.monotonic(), arrived()
                end, counting = begun + seconds, True
                await asyncio.sleep(seconds)
                rate = (arrived() - first) / (time.monotonic() - begun)
            await until(lambda: arrived() == posted, "all have arrived", 60)
            return rate


async def latency(folder: Path, synchronous: Synchronous, letters: int) -> Spread:
    """Milliseconds from the moment before a message is posted on one board to its arrival at one of another board."""
    with boards(folder, {"ann": "b1", "bob": "b2"}, synchronous) as made:
        async with member(made.endpoints["b1"], "ann") as ann, member(made.endpoints["b2"], "bob") as bob:
            bob.open()
            await _letters(ann, bob, 10)
            return await _letters(ann, bob, letters)


async def _letters(sender: Member, receiver: Member, count: int, pause: float = 0.01) -> Spread:
    """One message after the other."""
    values = []
    for _ in range(count):
        values.append(await _one(sender, receiver))
        await asyncio.sleep(pause)
    return spread(values)


async def _one(sender: Member, receiver: Member) -> float:
    """Milliseconds of one message."""
    arrived: asyncio.Future[float] = asyncio.get_running_loop().create_future()

    def note(message: Message, now: float) -> None:
        if message.sender == sender.name and not arrived.done():
            arrived.set_result(now)

    receiver.on_message = note
    begun = time.monotonic()
    await sender.post([receiver.name])
    return 1000 * (await asyncio.wait_for(arrived, 60) - begun)


async def caught_up(
    folder: Path, synchronous: Synchronous, messages: int, *, board_away: bool, settle: float = 2.0, before: int = 100
) -> Caught:
    """Let messages wait for one that is away, its daemon or its whole board; how it catches up, and how others fare.

    After `settle` seconds the latency of so many messages of others is measured `before` the backlog moves.
    """
    names = {"ann": "b1", "bob": "b2", "cid": "b3" if board_away else "b2"}
    with boards(folder, names, synchronous, start=False) as made:
        made.start("b1")
        made.start("b2")
        async with AsyncExitStack() as stack:
            ann = await stack.enter_async_context(member(made.endpoints["b1"], "ann"))
            bob = await stack.enter_async_context(member(made.endpoints["b2"], "bob"))
            bob.open()
            other = await stack.enter_async_context(member(made.endpoints["b1"], "ann"))  # a second hand of hers
            for _ in range(messages // BATCH):
                await ann.post(["cid"] * BATCH)
            await asyncio.sleep(settle)
            alone = await _letters(other, bob, before, TRICKLE)
            if board_away:
                made.start("b3")
            begun = time.monotonic()
            cid = await stack.enter_async_context(member(made.endpoints[names["cid"]], "cid"))
            cid.open()
            meanwhile: list[float] = []
            whole = messages // BATCH * BATCH
            while cid.came["ann"] < whole:
                if time.monotonic() > begun + 300:
                    raise BenchmarkFailed(f"{cid.came['ann']} of {whole} after 300 s")
                meanwhile.append(await _one(other, bob))
                await asyncio.sleep(TRICKLE)
            return Caught(time.monotonic() - begun, alone, spread(meanwhile))


async def resident(folder: Path, queued: int, settle: float = SETTLE) -> Resident:
    """MB of a commd beside those of a bare process that has what it is made of."""
    with boards(folder, {"ann": "b1", "bob": "b1"}, "full") as made:
        arguments = bare_process(f"tcp/127.0.0.1:{free_port()}", *_HAS, mode="router")
        with watched("bare", *arguments) as bare:
            bare.says("open")
            async with member(made.endpoints["b1"], "ann") as ann:
                await asyncio.sleep(settle)
                pid = made.daemons["b1"].process.pid
                empty = memory(pid, "VmRSS")
                for _ in range(queued // BATCH):
                    await ann.post(["bob"] * BATCH)
                await asyncio.sleep(settle)
                return Resident(memory(bare.process.pid, "VmRSS"), empty, memory(pid, "VmRSS"))


def in_folder(measure: Callable[[Path], Awaitable[T]]) -> T:
    """Measure in a folder of its own."""

    async def run(folder: Path) -> T:
        return await measure(folder)

    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(run(Path(folder)))


def measure(quick: bool) -> Figures:
    """Run everything once. Raises BenchmarkFailed."""
    seconds, letters, backlog, queued = (1.0, 20, 2_400, 2_000) if quick else (SECONDS, LETTERS, BACKLOG, QUEUED)
    tokens = 600 if quick else TOKENS
    tell("throughput")
    full = in_folder(lambda at: throughput(at, "full", seconds))
    normal = in_folder(lambda at: throughput(at, "normal", seconds))
    tell("latency")
    latency_full = in_folder(lambda at: latency(at, "full", letters))
    latency_normal = in_folder(lambda at: latency(at, "normal", letters))
    tell("a backlog")
    away = partial(caught_up, settle=0.5, before=20) if quick else caught_up
    agent_away = in_folder(lambda at: away(at, "full", backlog, board_away=False))
    board_away = in_folder(lambda at: away(at, "full", backlog, board_away=True))
    tell("memory")
    held = in_folder(lambda at: resident(at, queued, 0.5 if quick else SETTLE))
    tell("agents that write to one another, and one that asks who is there")
    return Figures(
        seconds=seconds,
        backlog=backlog // BATCH * BATCH,
        queued=queued,
        tokens=tokens,
        rate_full=full,
        rate_normal=normal,
        latency_full=latency_full,
        latency_normal=latency_normal,
        agent_away=agent_away,
        board_away=board_away,
        memory=held,
        talk=in_folder(lambda at: talk(at, backlog // 12)),
        presence=in_folder(lambda at: presence(at, tokens)),
        fsync=fsync(),
    )
