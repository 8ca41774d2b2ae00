"""The page of the mail's figures, docs/mail-figures.md."""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import tempfile
import time
from datetime import UTC, datetime
from importlib.metadata import version

from benchmarks.mail import BATCH, FLYING, TRICKLE, Figures, Latency

GOAL_RATE, GOAL_RSS, GOAL_STALL = 3_000.0, 10.0, 10.0
"""Messages a second, MB above a bare process, latency beside a backlog against that without."""


def report(figures: Figures, args: argparse.Namespace) -> str:
    """The figures as a page."""
    mem, talking, many = figures.memory, figures.talk, figures.crowd
    full, normal = figures.latencies
    rows: list[tuple[str, str, str, bool | None]] = [
        (f"messages/s, three boards, {name}", f"{rate:,.0f}", f"{GOAL_RATE:,.0f}", rate >= GOAL_RATE)
        for name, rate in zip(("FULL", "NORMAL"), figures.rates, strict=True)
    ]
    rows += [
        ("latency across two commd, FULL, p50 / p99", str(full), "", None),
        ("latency across two commd, NORMAL, p50 / p99", str(normal), "", None),
        ("messages/s between agents on three boards, FULL", f"{talking.rate:,.0f}", "", None),
    ]
    for who, caught in (("its agentd", figures.agent_away), ("its whole board", figures.board_away)):
        rows += [
            (
                f"{args.backlog:,} messages for one whose {who[4:]} was away: caught up in",
                f"{caught.seconds:.1f} s",
                "",
                None,
            ),
            (
                "- latency of others before, meanwhile (p50 / p99)",
                f"{caught.before}, {caught.meanwhile}: x {caught.ratio:.1f}",
                f"x {GOAL_STALL:g}",
                caught.ratio <= GOAL_STALL,
            ),
        ]
    for what, held in (("empty", mem.empty), (f"with {args.queued:,} queued messages", mem.queued)):
        above = held - mem.bare
        told = f"{above:.1f} MB ({held:.1f} - {mem.bare:.1f})"
        rows.append((f"memory of commd above a bare process, {what}", told, f"{GOAL_RSS:g} MB", above <= GOAL_RSS))
    rows += [
        (
            f"{args.agents} agents in one agentd: started in",
            f"{many.start:.1f} s (1 agent: {many.alone.start:.1f} s)",
            "",
            None,
        ),
        ("- memory per agent", f"{many.per_agent:.2f} MB ({many.rss:.0f} MB in all)", "", None),
        (
            f"- a question and its answer, with {args.tokens:,} presence tokens on the bus (p50 / p99)",
            f"{Latency(many.round_trips)}; 1 agent: {Latency(many.alone.round_trips)}",
            "",
            None,
        ),
        (f"- {args.tokens:,} tokens told to an agent that asks for presence in", f"{many.presence:.1f} s", "", None),
    ]
    table = "\n".join(
        f"| {what} | {value} | {goal} | {'' if met is None else 'met' if met else 'missed'} |"
        for what, value, goal, met in rows
    )
    return f"""# What mail costs

Written by `make bench-mail` on {datetime.now(UTC):%Y-%m-%d}: Python {platform.python_version()}, eclipse-zenoh
{version("eclipse-zenoh")}, {os.cpu_count()} cores of {platform.machine()}, {_disk()}. All daemons and the
benchmark share them.

| figure | measured | goal | |
|---|---|---|---|
{table}

* Three boards: a `commd` each, routers connected over loopback TCP. Each board's member posts batches of {BATCH} to
  both others, with at most {FLYING:,} messages on their way; what has arrived in {args.seconds:g} s counts. Members
  are no minds: they take and count. Between agents each message is a `.send` and a plan of the receiver.
* FULL and NORMAL are SQLite's `synchronous`, the mission's `mail: {{synchronous: ...}}`. A message across two boards is
  committed three times on its way: in the outbox of one, in the inbox of the other, and where it is removed.
* Latency: from before the post on one board to the arrival at a member of the other, one message at a time.
* Backlog: FULL; the latency of others is that of single messages between two other members, with
  {1000 * TRICKLE:g} ms between them.
* The bare process has a router's Zenoh session, msgspec, asyncio and an open SQLite database, and does nothing.
"""


def _disk() -> str:
    """What a commit costs here: the median of writing a page and fsync."""
    with tempfile.NamedTemporaryFile() as file:
        values = []
        for _ in range(50):
            begun = time.perf_counter()
            os.pwrite(file.fileno(), b"\0" * 4096, 0)
            os.fsync(file.fileno())
            values.append(time.perf_counter() - begun)
    return f"fsync {1000 * statistics.median(values):.2f} ms"
