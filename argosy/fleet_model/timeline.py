"""What happens in a fleet, entry by entry with running numbers: a client asks for all since the last that it has."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import Any, Literal

from argosy.cli.journal import Level
from schemas.humanize import shortened

MOST = 5_000
"""Entries that are kept."""

What = Literal[
    "action", "outcome", "print", "log", "sent", "received", "undelivered", "operator", "came", "went", "told"
]
"""What an entry is about: `came` and `went` are of daemons, `told` is what robots and daemons say of themselves."""


@dataclass(frozen=True)
class Entry:
    """One thing that happened."""

    number: int
    """Counts up from 1."""
    at: float
    """Unix seconds."""
    who: str
    """The agent, robot or board; `router`."""
    what: What
    text: str
    level: Level = "info"
    id: str = ""
    """Of the action or message."""
    other: str = ""
    """The agent to which or from which a message goes."""
    performative: str = ""
    in_reply_to: str = ""
    state: str = ""
    """Of an outcome: the final state of the action."""
    reason: str = ""
    """Why an action failed or a message was not delivered."""
    mission: float | None = None
    """Mission seconds of the agent's clock, if an agent told of it."""

    @property
    def clock(self) -> str:
        """The time of day of this machine."""
        return time.strftime("%H:%M:%S", time.localtime(self.at))

    def __str__(self) -> str:
        return f"{self.clock}  {self.who}: {self.text}"


class Timeline:
    """Keeps the last entries."""

    def __init__(self, most: int = MOST) -> None:
        self.entries: deque[Entry] = deque(maxlen=most)
        self.number = 0
        """Of the last entry."""

    def add(
        self, at: float, who: str, what: What, text: str, level: Level = "info", *, id: str = "", **more: Any
    ) -> Entry:
        """Note that something happened; `more` are further fields of the entry."""
        self.number += 1
        short: dict[str, Any] = {
            name: shortened(value) if isinstance(value, str) else value for name, value in more.items()
        }
        entry = Entry(self.number, at, who, what, shortened(text), level, shortened(id), **short)
        self.entries.append(entry)
        return entry

    def since(self, number: int, most: int = MOST) -> list[Entry]:
        """Return the entries after that number, at most the newest so many; older ones may be gone already."""
        new = min(max(0, self.number - number), len(self.entries), most)
        return list(islice(self.entries, len(self.entries) - new, None))
