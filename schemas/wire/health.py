"""Whom a health record is about: that of an `agentd` is about all its agents of a board, any other about one name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

from msgspec.structs import replace

from schemas.wire.keys import is_name
from schemas.wire.records import AgentHealth, Health

BoardOf: TypeAlias = Callable[[str], str | None]
"""Returns the board of an agent; None: not known."""


def agents_of(
    board: str, health: Health, agents: Iterable[str], board_of: BoardOf
) -> Iterator[tuple[str, AgentHealth]]:
    """Yield those of some agents that the record of a board's agentd is about, and what it has of each.

    `board_of` as in `each_health`.
    """
    for agent in agents:
        if (its := health.agents.get(agent)) is not None and board_of(agent) in (None, board):
            yield agent, its


def each_health(name: str, health: Health, board_of: BoardOf = lambda _: None) -> Iterator[tuple[str, Health]]:
    """Yield each name that a record on the key of `name` is about, and the health of that name alone.

    An agent whose `board_of` is another board is ignored: access control enforces the board in the key, and no board
    speaks for agents of another. None: not known.
    """
    if not health.agents:
        yield name, health
    for agent, its in health.agents.items():
        if is_name(agent) and board_of(agent) in (None, name):
            yield (
                agent,
                replace(
                    health,
                    header=replace(health.header, source=agent),
                    drops=health.drops + its.drops,
                    bad_input=health.bad_input + its.bad_input,
                    counters=health.counters | its.counters,
                    notes=its.notes + health.notes,
                    lag=max(health.lag, its.lag),
                    last_error=its.last_error or health.last_error,
                    last_error_age=its.last_error_age if its.last_error else health.last_error_age,
                    idle=its.idle,
                    agents={},
                    left_out=0,
                ),
            )
