"""What mail costs: messages a second over three boards, latency across two, a backlog, and the memory of its daemon.

Three `commd` run as on boards, with routers that know one another; the members that post and take are in this process,
without minds. All of them share this machine.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, TypeVar

from benchmarks.boards import Member, boards, member, until
from benchmarks.crowd import Crowd, Talk, crowd, talk
from benchmarks.processes import BenchmarkFailed, memory
from benchmarks.watched import watched
from schemas.records import Message
from tests.support.ports import free_port

Synchronous = Literal["full", "normal"]
T = TypeVar("T")

SECONDS: Final = 15.0
LETTERS: Final = 400
"""Single messages whose latency is measured."""
BACKLOG: Final = 36_000
"""An hour at 10 messages a second."""
QUEUED: Final = 100_000
BATCH: Final = 200
FLYING: Final = 4_000
"""Messages on their way at most while the throughput is measured."""
TRICKLE: Final = 0.01
"""Seconds between two messages whose latency tells what others suffer."""
_BARE: Final = """\
import asyncio, sqlite3, sys, msgspec, zenoh
from commd.session import session_config
class Message(msgspec.Struct):
    name: str
msgspec.json.Decoder(Message), msgspec.json.Encoder()
database = sqlite3.connect(sys.argv[2])
database.execute("PRAGMA journal_mode=WAL")
database.execute("CREATE TABLE letters (id INTEGER PRIMARY KEY, body BLOB)")
async def main():
    with zenoh.open(session_config("router", sys.argv[1], "bare")) as session:
        print("ready", flush=True)
        await asyncio.sleep(600)
asyncio.run(main())
"""


@dataclass(frozen=True)
class Latency:
    """Milliseconds, sorted."""

    values: list[float]

    def percentile(self, part: float) -> float:
        """Milliseconds that so large a part of the values stayed under."""
        return self.values[min(len(self.values) - 1, round(part * len(self.values)))]

    def __str__(self) -> str:
        return f"{self.percentile(0.5):.1f} / {self.percentile(0.99):.1f} ms"


@dataclass(frozen=True)
class Catching:
    """How a backlog was caught up with."""

    seconds: float
    before: Latency
    """Of other messages, before the backlog moved."""
    meanwhile: Latency

    @property
    def ratio(self) -> float:
        """Latency of others meanwhile against before, at p50."""
        return self.meanwhile.percentile(0.5) / self.before.percentile(0.5)


@dataclass(frozen=True)
class Memory:
    """MB of resident memory."""

    bare: float
    empty: float
    queued: float
    """With so many messages that wait."""


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


async def latency(folder: Path, synchronous: Synchronous, letters: int) -> Latency:
    """From the moment before a message is posted on one board to its arrival at a member of another one."""
    with boards(folder, {"ann": "b1", "bob": "b2"}, synchronous) as made:
        async with member(made.endpoints["b1"], "ann") as ann, member(made.endpoints["b2"], "bob") as bob:
            bob.open()
            await _letters(ann, bob, 10)
            return await _letters(ann, bob, letters)


async def _letters(sender: Member, receiver: Member, count: int, pause: float = 0.01) -> Latency:
    """One message after the other."""
    values = []
    for _ in range(count):
        values.append(await _one(sender, receiver))
        await asyncio.sleep(pause)
    return Latency(sorted(values))


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


async def caught_up(folder: Path, synchronous: Synchronous, messages: int, *, board_away: bool) -> Catching:
    """Let messages wait for one that is away, its daemon or its whole board; how it catches up, and how others fare."""
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
            await asyncio.sleep(2.0)
            before = await _letters(other, bob, 100, TRICKLE)
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
            return Catching(time.monotonic() - begun, before, Latency(sorted(meanwhile)))


async def resident(folder: Path, queued: int) -> Memory:
    """MB of a commd beside those of a bare process that has what it is made of."""
    with boards(folder, {"ann": "b1", "bob": "b1"}, "full") as made:
        arguments = ("-c", _BARE, f"tcp/127.0.0.1:{free_port()}", str(folder / "bare.db"))
        with watched("bare", *arguments) as bare:
            bare.says("ready")
            async with member(made.endpoints["b1"], "ann") as ann:
                await asyncio.sleep(3.0)
                pid = made.daemons["b1"].process.pid
                empty = memory(pid, "VmRSS")
                for _ in range(queued // BATCH):
                    await ann.post(["bob"] * BATCH)
                await asyncio.sleep(3.0)
                return Memory(memory(bare.process.pid, "VmRSS"), empty, memory(pid, "VmRSS"))


@dataclass(frozen=True)
class Figures:
    """What one run measured; of FULL and NORMAL, in this order, where both are."""

    rates: tuple[float, float]
    latencies: tuple[Latency, Latency]
    agent_away: Catching
    board_away: Catching
    memory: Memory
    talk: Talk
    crowd: Crowd


def in_folder(measure: Callable[[Path], Awaitable[T]]) -> T:
    """Measure in a folder of its own."""

    async def run(folder: Path) -> T:
        return await measure(folder)

    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(run(Path(folder)))


def measure(seconds: float, letters: int, backlog: int, queued: int, agents: int, tokens: int) -> Figures:
    """Run everything once. Raises BenchmarkFailed."""
    rates = tuple(in_folder(lambda at, s=s: throughput(at, s, seconds)) for s in ("full", "normal"))  # type: ignore[misc]
    latencies = tuple(in_folder(lambda at, s=s: latency(at, s, letters)) for s in ("full", "normal"))  # type: ignore[misc]
    return Figures(
        (rates[0], rates[1]),
        (latencies[0], latencies[1]),
        in_folder(lambda at: caught_up(at, "full", backlog, board_away=False)),
        in_folder(lambda at: caught_up(at, "full", backlog, board_away=True)),
        in_folder(lambda at: resident(at, queued)),
        in_folder(lambda at: talk(at, backlog // 12)),
        in_folder(lambda at: crowd(at, agents, tokens)),
    )


def main() -> int:
    """Measure, and write the page. Returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="of throughput, each")
    parser.add_argument("--letters", type=int, default=LETTERS)
    parser.add_argument("--backlog", type=int, default=BACKLOG)
    parser.add_argument("--queued", type=int, default=QUEUED)
    parser.add_argument("--agents", type=int, default=200)
    parser.add_argument("--tokens", type=int, default=1000)
    parser.add_argument("--out", type=Path, help="file for the report; none = the terminal only")
    args = parser.parse_args()
    try:
        figures = measure(args.seconds, args.letters, args.backlog, args.queued, args.agents, args.tokens)
    except BenchmarkFailed as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    from benchmarks.mail_page import report  # it reads what stands above

    text = report(figures, args)
    print(text)
    if args.out is not None:
        args.out.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
