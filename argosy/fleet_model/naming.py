"""Names as they may stand in a key: everything else is left alone, as no agent, robot or board can have it."""

from __future__ import annotations

from schemas.wire import keys
from schemas.wire.keys import check_name


def named(key: str) -> tuple[str, str, list[str]] | None:
    """Split a key of ours into fleet, name and the rest; None if it is none, or these are no names: nobody has them."""
    parsed = keys.parse(key)
    try:
        return parsed if parsed is not None and check_name(parsed[0]) and check_name(parsed[1]) else None
    except ValueError:
        return None
