"""Events of a fleet in order, each with a number, so that a view asks for those after the last that it has.

Robots, bridges and agents report the same actions; each beginning and each outcome is entered once.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from itertools import islice
from typing import Literal

import msgspec

from argosy.cli.journal import Level
from argosy.fleet_model.message_log import MessageLog
from schemas.humanize import shortened
from schemas.wire.mind_records import ActivityEvent, MindActivity
from schemas.wire.records import ActionStatus

MOST = 5_000
"""Entries that are kept."""
MOST_REPORTED = 5_000
"""Beginnings and outcomes of actions that are remembered as entered."""
LONGEST_WAIT = 5.0
"""Wall seconds that an activity event may have waited before it was published."""
LEVELS: dict[str, Level] = {"error": "error", "warning": "warning"}

What = Literal[
    "action", "outcome", "print", "log", "sent", "received", "undelivered", "operator", "came", "went", "report"
]
"""Kind of an entry: `came` and `went` are of daemons, `report` is a change that a robot or daemon reports."""


class Entry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One event."""

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
    mission: float | None = None
    """Mission seconds, by the clock of the run in which it happened; None = not known then."""

    def __str__(self) -> str:
        return f"{clock(self.at)}  {self.who}: {self.text}"


def clock(at: float) -> str:
    """Return the time of day on this machine of a time in Unix seconds."""
    return time.strftime("%H:%M:%S", time.localtime(at))


class Timeline:
    """Keeps the last entries."""

    def __init__(self, mission_seconds: Callable[[float], float | None]) -> None:
        """`mission_seconds` converts Unix seconds; None = not known."""
        self._mission_seconds = mission_seconds
        self.entries: deque[Entry] = deque(maxlen=MOST)
        self.number = 0
        """Of the last entry."""
        self.listener: Callable[[Entry], None] | None = None
        """Called with each new entry."""

    def add(
        self, at: float, who: str, what: What, text: str, level: Level = "info", *, id: str = "", other: str = ""
    ) -> Entry:
        """Enter an event. `at` is in Unix seconds."""
        self.number += 1
        id, other, mission = shortened(id), shortened(other), self._mission_seconds(at)
        entry = Entry(self.number, at, who, what, shortened(text), level, id, other, mission)
        self.entries.append(entry)
        if self.listener is not None:
            self.listener(entry)
        return entry

    def since(self, number: int) -> list[Entry]:
        """Return the entries after that number; the oldest may be gone already."""
        new = min(max(0, self.number - number), len(self.entries))
        return list(islice(self.entries, len(self.entries) - new, None))


class Reporter:
    """Enters changes and activity in the timeline, and messages in their log. A call enters a change."""

    def __init__(self, timeline: Timeline, messages: MessageLog, now: Callable[[], float], rate: float = 1.0) -> None:
        """`rate`: seconds of `now` per wall second."""
        self._timeline, self._messages, self._now, self._rate = timeline, messages, now, rate
        self.left_out = 0
        """Activity events that agents did not publish, because there were too many at a time."""
        self._reported: dict[tuple[What, str], None] = {}

    def __call__(self, who: str, text: str, level: Level = "info") -> None:
        """Enter a change that `who` reports of itself."""
        self._timeline.add(self._now(), who, "report", text, level)

    def action(self, status: ActionStatus, who: str, text: str, level: Level = "info") -> None:
        """Enter the beginning or the outcome of an action, as its bridge reports it."""
        what: What = "outcome" if status.final else "action"
        if self._is_new(what, status.id):
            self._timeline.add(self._now(), who, what, text, level, id=status.id)

    def activity(self, agent: str, activity: MindActivity) -> None:
        """Enter what an agent has done."""
        for event in activity.events:
            late = (activity.now - event.time) / activity.speed if activity.now and activity.speed > 0 else 0.0
            at = self._now() - min(max(0.0, late), LONGEST_WAIT) * self._rate
            self._messages.event(agent, event, at)
            what: What = "report" if event.kind == "stopped" else event.kind
            if what not in ("action", "outcome") or self._is_new(what, event.id):
                level, text = _level(event), _text(agent, event)
                self._timeline.add(at, agent, what, text, level, id=event.id, other=event.other)
        self.left_out += activity.left_out
        if activity.left_out:
            self(agent, f"{activity.left_out} of its activity events were not published: too many at a time", "warning")

    def _is_new(self, what: What, id: str) -> bool:
        if not id:
            return True
        id = shortened(id)
        if (what, id) in self._reported:
            return False
        self._reported[what, id] = None
        if len(self._reported) > MOST_REPORTED:
            del self._reported[next(iter(self._reported))]
        return True


def _level(event: ActivityEvent) -> Level:
    match event.kind:
        case "print":
            return "print"
        case "action":
            return "action"
        case "outcome":
            return "good" if event.state == "succeeded" else "warning"
        case "undelivered" | "operator" | "stopped":
            return "warning"
        case "log":
            return LEVELS.get(event.state, "info")
    return "info"


def _text(agent: str, event: ActivityEvent) -> str:
    why = f": {event.reason}" if event.reason else ""
    match event.kind:
        case "sent":
            return f"→ {event.other} {event.performative} {event.text.removesuffix(f'[source({agent})]')}"
        case "received":
            text = event.text.removesuffix(f"[source({event.other})]")
            return f"← {event.other} {event.performative} {text}"
        case "undelivered":
            return f"not delivered to {event.other}: {event.performative} {event.text}{why}"
        case "outcome":
            return f"{event.text} {event.state}{why}".strip()
        case "stopped":
            return f"stopped {event.text}{why}".rstrip()
        case "operator":
            return f"the operator: {event.text}{why}"
    return event.text
