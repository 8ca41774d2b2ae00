"""Agents of the mail's benchmark: three that write to one another as fast as they can, and one that asks who is there.

What many agents in one agentd cost, and how they talk, is measured by `benchmarks.crowd`.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.mail.boards import FLEET, Boards, boards, member, until
from benchmarks.processes import BenchmarkFailed
from benchmarks.watched import Watched, watched
from commd.bus.bus import Bus, open_bus
from commd.bus.errors import QueryFailed
from schemas.wire import keys
from schemas.wire.mind_records import MindView

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


@dataclass(frozen=True)
class Talk:
    """Agents that write to one another."""

    rate: float
    """Messages a second, from `.send` to the end of the receiver's plan, of all together."""


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


async def presence(folder: Path, tokens: int) -> float:
    """Declare so many tokens at once on one board; return the seconds until an agent of another, which asks for
    presence, believes them all."""
    (folder / "a0.asl").write_text("")
    with boards(folder, {"a0": "b1", "probe": "b2"}, "full", start=False) as made:
        text = made.mission.read_text().replace("a0: {program: a0.asl,", "a0: {program: a0.asl, presence: true,")
        made.mission.write_text(text + "clients:\n" + "".join(f"  x{one}: {{board: b2}}\n" for one in range(tokens)))
        for board in made.endpoints:
            made.start(board)
        async with AsyncExitStack() as stack:
            daemon = stack.enter_context(watched("agentd", *_agentd(made, "b1", folder)))
            await asyncio.to_thread(daemon.says, "agents=")
            where = made.endpoints["b2"]
            bus = await stack.enter_async_context(
                open_bus(where, fleet=FLEET, name="tokens", daemon="client", stamp=time.time_ns, patience=20)
            )
            before, begun = await _settled(bus), time.monotonic()
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
    try:
        view = await bus.ask_one(f"{keys.mind(FLEET, 'a0')}?about=online", None, MindView, 5)
    except QueryFailed:
        return -1
    return len(view.beliefs) + view.beliefs_left_out
