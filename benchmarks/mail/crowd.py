"""Agents of a benchmark: three that write to one another as fast as they can, and hundreds in one agentd."""

from __future__ import annotations

import asyncio
import re
import time
from contextlib import AsyncExitStack, aclosing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.mail.boards import FLEET, Boards, Member, boards, member, until
from benchmarks.processes import BenchmarkFailed, memory
from benchmarks.spread import Spread, spread
from benchmarks.watched import Watched, watched
from commd.bus import Bus, open_bus
from schemas import keys
from schemas.minds import MindView
from schemas.records import Message

ROUNDS: Final = 200
"""Questions whose answers are waited for."""
SETTLE: Final = 3.0
_TALKER: Final = """\
{left}
!begin.
+!begin <- .wait(go); {goals}.
+!talk(A) : left(A, N) & N > 0 <- .send(A, tell, item(N)); -left(A, N); +left(A, N - 1); !!talk(A).
+!talk(A) <- .print("sent all to ", A).
taken(0).
@t[atomic] +item(N)[source(S)] : taken(T) <- -item(N)[source(S)]; -taken(T); +taken(T + 1); !told(T + 1).
+!told({total}) <- .print("taken all").
+!told(_).
"""
_ECHO: Final = "+ping(N)[source(S)] <- -ping(N)[source(S)]; .send(S, tell, pong(N)).\n"


@dataclass(frozen=True)
class Talk:
    """Agents that write to one another."""

    rate: float
    """Messages a second, from `.send` to the end of the receiver's plan, of all together."""


@dataclass(frozen=True)
class Alone:
    """One agent in an agentd."""

    start: float
    """Seconds from the start of the process until it serves."""
    rss: float
    """MB."""
    round_trips: Spread
    """Milliseconds from a message to the agent's answer."""


@dataclass(frozen=True)
class Crowd:
    """Many agents in one agentd."""

    alone: Alone
    start: float
    rss: float
    per_agent: float
    """MB."""
    round_trips: Spread
    presence: float
    """Seconds until an agent believed all tokens that were declared at once."""


def _agentd(made: Boards, board: str, folder: Path) -> tuple[str, ...]:
    command = ("-m", "agentd", "serve", str(made.mission), "--board", board, "--router", made.endpoints[board])
    return (*command, "--state", str(folder / f"{board}-minds"))


async def talk(folder: Path, each: int) -> Talk:
    """Three agents on three boards: each sends `each` messages to both others."""
    names = {"ann": "b1", "bob": "b2", "cid": "b3"}
    for name in names:
        others = [other for other in names if other != name]
        left = " ".join(f"left({other}, {each})." for other in others)
        goals = "; ".join(f"!!talk({other})" for other in others)
        (folder / f"{name}.asl").write_text(_TALKER.format(left=left, goals=goals, total=2 * each))
    with boards(folder, {**names, "starter": "b1"}, "full") as made:
        (folder / "starter.asl").write_text("")
        async with AsyncExitStack() as stack:
            command = [_agentd(made, board, folder) for board in made.endpoints]
            daemons = [stack.enter_context(watched("agentd", *one)) for one in command]
            for daemon in daemons:
                await asyncio.to_thread(daemon.says, "agents=")
            starter = await stack.enter_async_context(member(made.endpoints["b1"], "starter"))
            begun = time.monotonic()
            await starter.post(list(names), "go")
            await until(lambda: all(_said(one, "taken all") for one in daemons), "all is taken", 300)
            last = max(at for one in daemons for at, line in one.said if "taken all" in line)
            return Talk(6 * each / (last - begun))


def _said(daemon: Watched, words: str) -> bool:
    return any(words in line for _, line in daemon.said)


async def crowd(folder: Path, agents: int, tokens: int) -> Crowd:
    """Measure one agent, and then many, in one agentd."""
    alone = folder / "alone"
    alone.mkdir()
    (first, _) = await _measured(alone, 1, 0)
    (many, presence) = await _measured(folder, agents, tokens)
    per_agent = (many.rss - first.rss) / (agents - 1)
    return Crowd(first, many.start, many.rss, per_agent, many.round_trips, presence)


async def _measured(folder: Path, agents: int, tokens: int) -> tuple[Alone, float]:
    (folder / "echo.asl").write_text(_ECHO)
    names = [f"a{number}" for number in range(agents)]
    with boards(folder, {**dict.fromkeys(names, "b1"), "probe": "b2"}, "full", start=False) as made:
        text = re.sub(r"program: a\d+\.asl", "program: echo.asl", made.mission.read_text())
        text = text.replace("a0: {program: echo.asl,", "a0: {program: echo.asl, presence: true,")
        if tokens:
            text += "clients:\n" + "".join(f"  x{number}: {{board: b2}}\n" for number in range(tokens - agents))
        made.mission.write_text(text)
        for board in made.endpoints:
            made.start(board)
        async with AsyncExitStack() as stack:
            begun = time.monotonic()
            daemon = stack.enter_context(watched("agentd", *_agentd(made, "b1", folder)))
            await asyncio.to_thread(daemon.says, "agents=")
            start = time.monotonic() - begun
            probe = await stack.enter_async_context(member(made.endpoints["b2"], "probe"))
            probe.open()
            presence = await _tokens(stack, made, tokens - agents) if tokens else 0.0
            await asyncio.sleep(SETTLE)
            rss = memory(daemon.process.pid, "VmRSS")
            trips = [await _round_trip(probe, names[number % agents], number) for number in range(ROUNDS)]
            return Alone(start, rss, spread(trips)), presence


async def _round_trip(probe: Member, agent: str, number: int) -> float:
    answer: asyncio.Future[float] = asyncio.get_running_loop().create_future()

    def note(message: Message, now: float) -> None:
        if not answer.done():
            answer.set_result(now)

    probe.on_message = note
    begun = time.monotonic()
    await probe.post([agent], f"ping({number})")
    return 1000 * (await asyncio.wait_for(answer, 60) - begun)


async def _tokens(stack: AsyncExitStack, made: Boards, tokens: int) -> float:
    """Declare so many tokens on the second board; return the seconds until the agent that asks for presence believes
    them all."""
    bus = await stack.enter_async_context(
        open_bus(made.endpoints["b2"], fleet=FLEET, name="tokens", daemon="client", stamp=time.time_ns, patience=20)
    )
    before = await _settled(bus)
    begun = time.monotonic()
    for number in range(tokens):
        bus.token(keys.alive(FLEET, f"x{number}", "client", bus.boot))
    while time.monotonic() < begun + 60:
        if await _online(bus) == before + tokens:
            return time.monotonic() - begun
        await asyncio.sleep(0.05)
    raise BenchmarkFailed(f"the agent does not believe that {tokens} more are online than {before}")


async def _settled(bus: Bus) -> int:
    """How many the agent believes to be online, once that stays as it is."""
    last, until = -1, time.monotonic() + 60
    while time.monotonic() < until:
        now = await _online(bus)
        if now == last:
            return now
        last = now
        await asyncio.sleep(1.0)
    raise BenchmarkFailed("who is online does not come to rest")


async def _online(bus: Bus) -> int:
    """How many the agent believes to be online: those that a look shows, and those that it counts."""
    count = -1
    async with aclosing(bus.query(f"{keys.mind(FLEET, 'a0')}?about=online", None, MindView, 5)) as replies:
        async for reply in replies:
            if reply.record is not None:
                count = len(reply.record.beliefs) + reply.record.beliefs_left_out
    return count
