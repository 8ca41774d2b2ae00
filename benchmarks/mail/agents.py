"""Agents of the mail's benchmark: three that write to one another as fast as they can.

What many agents in one agentd cost, and how they talk, is measured by `benchmarks.crowd`.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import AsyncExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from benchmarks.mail.boards import boards, member, until
from benchmarks.processes import Watched, watched

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
            daemons = []
            for board, endpoint in made.endpoints.items():
                where = ("--board", board, "--router", endpoint, "--state", str(folder / f"{board}-minds"))
                command = ("-m", "agentd", "serve", str(made.mission), *where)
                daemons.append(stack.enter_context(watched("agentd", *command)))
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
