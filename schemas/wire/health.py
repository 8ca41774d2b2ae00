"""Whom a health record is about: that of an `agentd` is about all its agents of a board, any other about one name."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from msgspec.structs import replace

from schemas.wire.keys import is_name
from schemas.wire.records import Health


def each_health(
    name: str, health: Health, board_of: Callable[[str], str | None] = lambda _: None
) -> Iterator[tuple[str, Health]]:
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
