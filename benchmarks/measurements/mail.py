"""Part `mail`: messages a second over three boards, latency across two, a backlog, memory of commd.

Three `commd` run as on boards, with routers that know one another; the members that post and take are in this process,
without minds. All of them share this machine.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, TypeVar

from benchmarks.measurements.boards import PROBE, Member, Synchronous, boards, fsync, member, until
from benchmarks.parts import Goal, at_least, at_most, line_of_goals, progress, row, table
from benchmarks.processes import BenchmarkFailed, memory, watched
from benchmarks.results import Origin
from benchmarks.serving import bare as bare_process
from benchmarks.spread import Spread, spread
from schemas.wire.records import Message
from tests.support.ports import free_port

BATCH: Final = 200
"""Messages that are posted at once."""
TEAM: Final = {"ann": "b1", "bob": "b2", "cid": "b3"}
FLYING: Final = 4_000
"""Messages on their way at most while the throughput is measured."""
TRICKLE: Final = 0.01
"""Seconds between two messages whose latency shows the effect on others."""
GOAL_RATE, GOAL_RSS, GOAL_STALL = 3_000.0, 10.0, 10.0
"""Messages a second, MB above a bare process, latency beside a backlog against that without."""


@dataclass(frozen=True)
class Caught:
    """How a backlog was caught up with."""

    seconds: float
    before: Spread
    """Milliseconds of other messages, before the backlog moved."""
    meanwhile: Spread

    @property
    def ratio(self) -> float:
        """Latency of others meanwhile against before, at p50."""
        return self.meanwhile.p50 / self.before.p50


@dataclass(frozen=True)
class Resident:
    """MB of resident memory."""

    bare: float
    empty: float
    queued: float
    """With so many messages that wait."""


@dataclass(frozen=True)
class Talk:
    """Three agents on three boards that write to one another as fast as they can."""

    rate: float
    """Messages a second, from `.send` to the end of the receiver's plan, of all together."""
    cpu: float = 0.0
    """Microseconds of processor time of all daemons for a message; 0 = not measured."""


@dataclass(frozen=True)
class Figures:
    """What one run measured. FULL and NORMAL are the ways in which SQLite writes."""

    seconds: float
    """For which the throughput was measured."""
    backlog: int
    queued: int
    rate_full: float
    rate_normal: float
    """Messages a second."""
    latency_full: Spread
    latency_normal: Spread
    """Milliseconds."""
    agent_away: Caught
    board_away: Caught
    memory: Resident
    talk: Talk
    fsync: float
    """Milliseconds of this machine's disk."""


_BOUND: Final = (
    "three commd, their senders and receivers share this machine's cores, and a batch waits for the disk ({fsync:.2f} "
    "ms a write and fsync) at sender and receiver; tried: batches of {batch}, one transaction for each; which of them "
    "bounds it is not known"
)
_BESIDE: Final = (
    "one commd and one disk serve both; tried: one batch of a backlog on its way at a time, and couriers "
    "of their own for lines whose receivers answer; what is left of it is not known by its parts"
)
_HELD: Final = (
    "tried: messages that wait are on the disk and not in memory, SQLite's cache is bounded; what holds the rest is "
    "not known"
)


def goals(figures: Figures) -> list[Goal]:
    """Return what is asked of the mail."""
    bound = _BOUND.format(fsync=figures.fsync, batch=BATCH)
    found = [
        at_least(f"mail, three boards, {name}", GOAL_RATE, rate, "messages/s", bound)
        for name, rate in (("FULL", figures.rate_full), ("NORMAL", figures.rate_normal))
    ]
    for who, caught in (("agentd", figures.agent_away), ("whole board", figures.board_away)):
        title = f"latency of others (p50) while {figures.backlog:,} messages reach one whose {who} was away"
        ratio = f"x {caught.ratio:.1f} ({caught.before} ms, {caught.meanwhile} ms; p50 / p99)"
        found.append(Goal(title, f"at most x {GOAL_STALL:g}", ratio, caught.ratio <= GOAL_STALL, _BESIDE))
    held = figures.memory
    for what, megabytes in (("empty", held.empty), (f"with {figures.queued:,} queued messages", held.queued)):
        title = f"memory of commd above a bare process of {held.bare:.1f} MB (RSS), {what}"
        found.append(at_most(title, GOAL_RSS, megabytes - held.bare, "MB", _HELD))
    return found


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/measurements/daemons.md."""
    backlog = f"{figures.backlog:,} messages for one whose"
    rows = (
        ("latency across two commd, FULL (p50 / p99)", f"{figures.latency_full} ms"),
        ("latency across two commd, NORMAL", f"{figures.latency_normal} ms"),
        ("messages/s between agents on three boards, FULL", f"{figures.talk.rate:,.0f}"),
        (f"{backlog} agentd was away: caught up in", f"{figures.agent_away.seconds:.1f} s"),
        (f"{backlog} whole board was away", f"{figures.board_away.seconds:.1f} s"),
    )
    lines = [
        origin.line() + f" A write and fsync of its disk takes {figures.fsync:.2f} ms.",
        "",
        *line_of_goals(goals(figures)),
        "",
        *table("| figure | measured |", (row(*one) for one in rows)),
        "",
        f"Each board's member posts batches of {BATCH} to both others, with at most {FLYING:,} messages on their way; "
        f"what has arrived in {figures.seconds:g} s counts. The latency of others is that of single messages with "
        f"{1000 * TRICKLE:g} ms between them.",
    ]
    return {"mail": "\n".join(lines)}


T = TypeVar("T")

SECONDS: Final = 12.0
LETTERS: Final = 400
"""Single messages whose latency is measured."""
BACKLOG: Final = 36_000
"""An hour at 10 messages a second."""
QUEUED: Final = 100_000
SETTLE: Final = 3.0
"""Wall seconds until the memory of a daemon is looked at."""
_HAS: Final = ("asyncio", "msgspec", "sqlite3")
"""What commd has imported, and the bare process as well."""


async def throughput(folder: Path, synchronous: Synchronous, seconds: float) -> float:
    """Messages a second that arrive, summed over three boards each of which sends to both others."""
    with boards(folder, TEAM, synchronous) as made:
        async with AsyncExitStack() as stack:
            members = [
                await stack.enter_async_context(member(made.endpoints[board], name)) for name, board in TEAM.items()
            ]
            posted, counting = 0, False
            for one in members:
                one.open()

            def arrived() -> int:
                return sum(sum(one.came.values()) for one in members)

            async def keep_posting(one: Member) -> None:
                nonlocal posted
                others = [other for other in TEAM if other != one.name]
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


_TALKER: Final = """\
{left}
!begin.
+!begin <- .wait(go); {goals}.
+!talk(A) : left(A, N) & N > 0 <- .send(A, tell, item(N)); -left(A, N); +left(A, N - 1); !!talk(A).
+!talk(A) <- .print("sent all to ", A).
taken(0).
@t[atomic] +item(N)[source(S)] : taken(T) <- -item(N)[source(S)]; -taken(T); +taken(T + 1); !counted(T + 1).
+!counted({total}) <- .print("taken all").
+!counted(_).
"""


async def talk(folder: Path, each: int) -> Talk:
    """Three agents on three boards: each sends `each` messages to both others."""
    programs = {name: f"program: {name}.asl" for name in TEAM}
    for name in TEAM:
        others = [other for other in TEAM if other != name]
        left = " ".join(f"left({other}, {each})." for other in others)
        goals = "; ".join(f"!!talk({other})" for other in others)
        (folder / f"{name}.asl").write_text(_TALKER.format(left=left, goals=goals, total=2 * each))
    with boards(folder, TEAM, "full", programs=programs) as made:
        minds = [await asyncio.to_thread(made.think, board) for board in made.endpoints]
        daemons = [*made.daemons.values(), *minds]
        async with member(made.endpoints["b1"], PROBE) as starter:
            used, begun = sum(one.cpu() for one in daemons), time.monotonic()
            await starter.post(list(TEAM), "go")
            await until(lambda: all(one.when("taken all") for one in minds), "all is taken", 300)
            last, used = max(one.when("taken all") for one in minds), sum(one.cpu() for one in daemons) - used
            return Talk(6 * each / (last - begun), 1e6 * used / (6 * each))


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
            bare.wait_for("open")
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
    progress("throughput")
    full = in_folder(lambda at: throughput(at, "full", seconds))
    normal = in_folder(lambda at: throughput(at, "normal", seconds))
    progress("latency")
    latency_full = in_folder(lambda at: latency(at, "full", letters))
    latency_normal = in_folder(lambda at: latency(at, "normal", letters))
    progress("a backlog")
    away = partial(caught_up, settle=0.5, before=20) if quick else caught_up
    agent_away = in_folder(lambda at: away(at, "full", backlog, board_away=False))
    board_away = in_folder(lambda at: away(at, "full", backlog, board_away=True))
    progress("memory")
    held = in_folder(lambda at: resident(at, queued, 0.5 if quick else SETTLE))
    progress("agents that write to one another")
    return Figures(
        seconds=seconds,
        backlog=backlog // BATCH * BATCH,
        queued=queued,
        rate_full=full,
        rate_normal=normal,
        latency_full=latency_full,
        latency_normal=latency_normal,
        agent_away=agent_away,
        board_away=board_away,
        memory=held,
        talk=in_folder(lambda at: talk(at, backlog // 12)),
        fsync=fsync(),
    )


def probe(quick: bool) -> dict[str, float]:
    """Return what mail costs, in less time: less is better."""
    seconds, letters, talks, queued = (1.0, 20, 100, 2_000) if quick else (6.0, 200, 3_000, 50_000)
    rate = in_folder(lambda at: throughput(at, "full", seconds))
    alone = in_folder(lambda at: latency(at, "full", letters))
    talked = in_folder(lambda at: talk(at, talks))
    held = in_folder(lambda at: resident(at, queued))
    return {
        "message between boards, p50 (ms)": alone.p50,
        "many messages between boards (µs)": 1e6 / rate,
        "message between agents (µs)": 1e6 / talked.rate,
        "message between agents, processor time of all daemons (µs)": talked.cpu,
        "commd, empty (MB)": held.empty,
        f"commd, {queued:,} queued messages (MB)": held.queued,
    }
