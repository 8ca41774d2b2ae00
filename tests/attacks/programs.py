"""An attack by a program on the other agents of its agentd, whose robots are left when they report nothing."""

import asyncio
import time
from itertools import pairwise

from schemas.wire import keys
from schemas.wire.records import Health
from tests.attacks.world import NAME, Attack, Row, World, attack
from tests.support.buses import until
from tests.support.promises import in_time
from tests.support.secured import Secured

ROUNDS = 2
SILENCE = 4.0
"""Seconds that an agent may say nothing; a second later its robot is left (`agent_silence`)."""
MISSION = """
mission: three
security: {operators: [ops]}
boards: BOARDS
agents:
  a: {board: pi1, program: good.asl}
  evil: {board: pi1, program: evil.asl}
"""
GOOD = '!round(0). +!round(N) <- .print("round ", N); .wait(100); !round(N + 1).'
EVIL = f"""
!go({ROUNDS}).
+!go(0) <- .print("done").
+!go(N) <- !search; !sort; !compare; !grow("{"a" * 50}"); !count; !go(N - 1).
+!search <- .replace("{"a" * 50}b", "(a+)+$", "", _).
+!sort <- .findall(f(X), .range(X, 1, 400000), L); .shuffle(L, R); .sort(R, _).
+!compare <- !twice(x, 60, X); !twice(x, 60, Y); +big(X); ?big(Y).
+!twice(X, 0, X).
+!twice(X, N, R) <- !twice(f(X, X), N - 1, R).
+!grow(S) <- .replace("{"a" * 50}", "a", S, T); !grow(T).
+!count <- .findall(X, .range(X, 1, 10000000), _).
-!search[error(E)] <- .print("refused: ", E).
-!sort[error(E)] <- .print("refused: ", E).
-!compare[error(E)] <- .print("refused: ", E).
-!grow(_)[error(E)] <- .print("refused: ", E).
-!count[error(E)] <- .print("refused: ", E).
"""
CODES = ("too_much_work", "too_much_work", "recursion_too_deep", "too_large", "too_much_work")


@attack(
    "a program that leaves no time to its neighbours",
    "`evil`, in the agentd of `a`, searches by `(a+)+$`, sorts 400,000 structures, compares terms of 2^60 parts, "
    "replaces a text by longer ones, and counts to ten million",
    "agentd: each formula fails after a second or so of processor time, by a count of its steps or by time",
)
async def no_time(row: Row, _: World) -> None:
    """Let a program compute without end beside an agent that goes on."""
    with Secured(MISSION) as fleet:
        (fleet.folder / "good.asl").write_text(GOOD)
        (fleet.folder / "evil.asl").write_text(EVIL)
        of_programs = World(fleet)
        await asyncio.to_thread(fleet.start("pi1", "commd").says, "router board=")
        agentd = fleet.start("pi1", "agentd")
        async with of_programs.member("pi1") as member:
            heard: list[float] = []
            member.subscribe(keys.health(NAME, "pi1", "agentd"), Health, lambda *_: heard.append(time.monotonic()))
            await until(lambda: bool(heard), "the agents are heard")
            await asyncio.to_thread(agentd.says, "[evil] done", 120)
            rounds = agentd.text.count("[a] round ")
            await asyncio.to_thread(agentd.until, lambda text: text.count("[a] round ") > rounds, "`a` goes on", 30)
            gap = max(later - earlier for earlier, later in pairwise([*heard, time.monotonic()]))
        refused = [line.partition("refused: ")[2] for line in agentd.lines if "[evil] refused: " in line]
        row.expect(refused == [*CODES] * ROUNDS, f"each formula fails by its limit, not {refused}")
        row.expect(in_time(gap, SILENCE), f"the agents are heard at least every {SILENCE:g} s, not after {gap:.1f} s")
    row.seen.append(f"`evil`: {', '.join(f'`{code}`' for code in CODES)}")
    row.seen.append(f"`a` went on; the health of their agentd came {gap:.1f} s apart at most (1 s calm)")


PROGRAMS: tuple[Attack, ...] = (no_time,)
