"""How long the loop takes, beside bare exchanges of the same sizes, turn by turn in one run."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Final

import msgspec

from benchmarks.loop.board import Board, board, payload
from benchmarks.loop.raw import Sizes, raw
from benchmarks.processes import BenchmarkFailed
from schemas.wire.records import Action, ActionStatus, Header, Perception, Perceptions

PAUSE: Final = 0.008
"""Seconds between two exchanges: what one leaves to be done (an id synced to the disk) must not slow the next."""
WARM_UP: Final = 50


@dataclass
class Turns:
    """What one run measured, us, turn by turn."""

    put: list[float] = field(default_factory=list)
    """A put and a put back."""
    ask: list[float] = field(default_factory=list)
    """A query and its reply."""
    pong: list[float] = field(default_factory=list)
    """From the robot's sample to the action of its agent at the robot."""
    seen: list[float] = field(default_factory=list)
    """From the robot's sample to the next action of the plan at the robot."""


def sizes() -> Sizes:
    """Return the bytes of the loop's records, as they are encoded."""
    header = Header(seq=1000, stamp=time.time_ns(), source="thinker", boot="0123abcd")
    identity = f"thinker:{header.boot}:1000"
    records = (
        Perceptions(changes=(Perception(header=header, name="ping", parameters=(1000,), update="replace"),)),
        Action(header=header, id=identity, agent="thinker", name="pong", parameters=(1000,)),
        ActionStatus(
            header=header, id=identity, state="succeeded", result=True, after=1000, name="pong", parameters=(1000,)
        ),
    )
    return Sizes(len(payload(1000)), *(len(msgspec.json.encode(record)) for record in records))


def measure(turns: int, *, kept: bool = True) -> Turns:
    """Run the loop and the bare exchanges so often, one after the other. Raises BenchmarkFailed."""
    found = Turns()
    with board(kept=kept) as ours, raw(ours.endpoint, ours.session, sizes()) as bare:
        for number in range(1, WARM_UP + 1):
            bare.put_and_back()
            bare.ask()
            _loop(ours, number)
        for number in range(WARM_UP + 1, WARM_UP + turns + 1):
            found.put.append(bare.put_and_back() / 1000)
            time.sleep(PAUSE)
            found.ask.append(bare.ask() / 1000)
            time.sleep(PAUSE)
            begun, pong, seen = _loop(ours, number)
            found.pong.append((pong - begun) / 1000)
            found.seen.append((seen - begun) / 1000)
            time.sleep(PAUSE)
    return found


def _loop(ours: Board, number: int) -> tuple[int, int, int]:
    """Run the loop once. Returns the monotonic time in ns of the sample and of both actions. Raises BenchmarkFailed."""
    begun = time.monotonic_ns()
    ours.put("ping", number)
    pong, seen = ours.pong.when(number), ours.seen.when(number)
    if pong is None or seen is None:
        raise BenchmarkFailed(f"ping({number}) was not answered; last:\n{ours.last_words()}")
    return begun, pong, seen
