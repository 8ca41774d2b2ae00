"""Programs in Python that join a team: `join` makes a member with a mailbox, percepts and, with a robot, actions.

`blocking` is the same without an event loop. The modules below are the parts of a member that agentd uses as well:
`actions` (the action client), `percept_sync`, `manual_percepts`, `receive_once` and `receive_mail`,
`send_mail`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from commd.client.client import *  # noqa: F403


def __getattr__(name: str) -> Any:
    """Import the public names when they are first used: agentd needs only some of the parts."""
    if not name.startswith("_"):
        return getattr(import_module("commd.client.client"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
