"""What the mail's benchmark finds, and how docs/measurements/daemons.md tells it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from benchmarks.mail.agents import Talk
from benchmarks.parts import Goal, line_of_goals
from benchmarks.results import Origin
from benchmarks.spread import Spread

BATCH: Final = 200
"""Messages that are posted at once."""
FLYING: Final = 4_000
"""Messages on their way at most while the throughput is measured."""
TRICKLE: Final = 0.01
"""Seconds between two messages whose latency tells what others suffer."""
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
class Figures:
    """What one run measured. FULL and NORMAL are the ways in which SQLite writes."""

    seconds: float
    """For which the throughput was measured."""
    backlog: int
    queued: int
    tokens: int
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
    presence: float
    """Seconds until an agent of another board believed all tokens that were declared at once."""
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
        Goal(f"mail, three boards, {name}", f"{GOAL_RATE:,.0f} messages/s", f"{rate:,.0f}", rate >= GOAL_RATE, bound)
        for name, rate in (("FULL", figures.rate_full), ("NORMAL", figures.rate_normal))
    ]
    for who, caught in (("agentd", figures.agent_away), ("whole board", figures.board_away)):
        title = f"latency of others (p50) while {figures.backlog:,} messages reach one whose {who} was away"
        told = f"x {caught.ratio:.1f} ({caught.before} ms, {caught.meanwhile} ms; p50 / p99)"
        found.append(Goal(title, f"at most x {GOAL_STALL:g}", told, caught.ratio <= GOAL_STALL, _BESIDE))
    held = figures.memory
    for what, megabytes in (("empty", held.empty), (f"with {figures.queued:,} queued messages", held.queued)):
        above = megabytes - held.bare
        told = f"{above:.1f} MB ({megabytes:.1f} - {held.bare:.1f})"
        title = f"memory of commd above a bare process (RSS), {what}"
        found.append(Goal(title, f"{GOAL_RSS:g} MB", told, above <= GOAL_RSS, _HELD))
    return found


def pictures(_: Figures) -> dict[str, str]:
    """Return none."""
    return {}


def blocks(origin: Origin, figures: Figures) -> dict[str, str]:
    """Return the figures of docs/measurements/daemons.md."""
    rows = (
        ("latency across two commd, FULL (p50 / p99)", f"{figures.latency_full} ms"),
        ("latency across two commd, NORMAL", f"{figures.latency_normal} ms"),
        ("messages/s between agents on three boards, FULL", f"{figures.talk.rate:,.0f}"),
        (
            f"{figures.backlog:,} messages for one whose agentd was away: caught up in",
            f"{figures.agent_away.seconds:.1f} s",
        ),
        (f"{figures.backlog:,} messages for one whose whole board was away", f"{figures.board_away.seconds:.1f} s"),
        (
            f"{figures.tokens:,} tokens declared at once: told to an agent of another board that asks for presence in",
            f"{figures.presence:.1f} s",
        ),
    )
    lines = [
        origin.line() + f" A write and fsync of its disk takes {figures.fsync:.2f} ms.",
        "",
        *line_of_goals(goals(figures)),
        "",
        "| figure | measured |",
        "|---|---|",
        *(f"| {what} | {value} |" for what, value in rows),
        "",
        f"Each board's member posts batches of {BATCH} to both others, with at most {FLYING:,} messages on their way; "
        f"what has arrived in {figures.seconds:g} s counts. The latency of others is that of single messages with "
        f"{1000 * TRICKLE:g} ms between them.",
    ]
    return {"mail": "\n".join(lines)}
