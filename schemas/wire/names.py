"""Names of fleets, agents, robots and boards: each is one chunk of a Zenoh key expression."""

from __future__ import annotations

import re

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,63}")


def is_name(text: str) -> bool:
    """Whether a text may be a name, and so be a part of a key."""
    return _NAME.fullmatch(text) is not None


def check_name(name: str) -> str:
    """Return `name`, or raise ValueError that says what a name may be (no `* $ ? # /`, not empty)."""
    if not is_name(name):
        raise ValueError(f"Expected a name of letters, digits, `_`, `-` or `.` that starts with a letter, got `{name}`")
    return name
