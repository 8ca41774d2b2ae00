"""Which keys of a recording are those of one thing of one fleet: nothing else is said again.

A recording may hold whatever somebody put on the wire. A key with `*` in it reaches many fleets at once, and one that
is none of ours a robot that drives by it.
"""

from __future__ import annotations

from schemas.wire import keys

_EXPRESSIONS = frozenset("*$?#")
"""What no plain key has: it would be a key expression, or none at all."""


def is_plain(key: str) -> bool:
    """Whether a key names one thing: no part of it is empty or stands for others."""
    return _EXPRESSIONS.isdisjoint(key) and all(key.split("/"))


def fleet_of(key: str) -> str | None:
    """Return the fleet whose one key this is; None for every other key."""
    parsed = keys.parse(key) if is_plain(key) else None
    return parsed[0] if parsed is not None else None
