"""Puts what robots and agents tell into the timeline and the letters, each thing once: two may tell of one action."""

from __future__ import annotations

from collections.abc import Callable

from argosy.cli.journal import Level
from argosy.fleet_model.message_log import MessageLog
from argosy.fleet_model.timeline import Timeline, What
from schemas.humanize import shortened
from schemas.wire.mind_records import Deed, MindDeeds
from schemas.wire.records import ActionStatus

MOST = 5_000
"""Beginnings and ends of actions that are remembered as told."""
LONGEST_WAIT = 5.0
"""Seconds for which a deed may have waited until it was told."""
LEVELS: dict[str, Level] = {"error": "error", "warning": "warning"}


class Teller:
    """Takes changes and deeds; as a function it is what robots tell their changes to."""

    def __init__(self, timeline: Timeline, letters: MessageLog, now: Callable[[], float]) -> None:
        self._timeline, self._letters, self._now = timeline, letters, now
        self._told: dict[tuple[What, str], None] = {}

    def __call__(self, who: str, text: str, level: Level = "info") -> None:
        """Note what somebody tells of himself."""
        self._timeline.add(self._now(), who, "told", text, level)

    def action(self, status: ActionStatus, who: str, text: str, level: Level = "info") -> None:
        """Note that an action began or ended, as its bridge says."""
        what: What = "outcome" if status.final else "action"
        if self._is_new(what, status.id):
            state = status.state if status.final else ""
            self._timeline.add(self._now(), who, what, text, level, id=status.id, state=state, reason=status.reason)

    def deeds(self, agent: str, told: MindDeeds) -> None:
        """Note what an agent has done."""
        for deed in told.deeds:
            late = (told.now - deed.time) / told.speed if told.now and told.speed > 0 else 0.0
            self._deed(agent, deed, self._now() - min(max(0.0, late), LONGEST_WAIT))
        if told.left_out:
            self(agent, f"{told.left_out} more of its deeds are not told: too many at once", "warning")

    def _deed(self, agent: str, deed: Deed, at: float) -> None:
        self._letters.deed(agent, deed, at)
        what, level, text = _what(deed), _level(deed), _text(agent, deed)
        if what in ("action", "outcome") and not self._is_new(what, deed.id):
            return
        self._timeline.add(
            at,
            agent,
            what,
            text,
            level,
            id=deed.id,
            other=deed.other,
            performative=deed.performative,
            in_reply_to=deed.in_reply_to,
            state=deed.state,
            reason=deed.reason,
            mission=deed.time,
        )

    def _is_new(self, what: What, id: str) -> bool:
        if not id:
            return True
        id = shortened(id)
        if (what, id) in self._told:
            return False
        self._told[what, id] = None
        if len(self._told) > MOST:
            del self._told[next(iter(self._told))]
        return True


def _what(deed: Deed) -> What:
    return "told" if deed.kind == "stopped" else deed.kind


def _level(deed: Deed) -> Level:
    match deed.kind:
        case "print":
            return "print"
        case "action":
            return "action"
        case "outcome":
            return "good" if deed.state == "succeeded" else "warning"
        case "undelivered" | "operator" | "stopped":
            return "warning"
        case "log":
            return LEVELS.get(deed.state, "info")
    return "info"


def _text(agent: str, deed: Deed) -> str:
    why = f": {deed.reason}" if deed.reason else ""
    match deed.kind:
        case "sent":
            return f"→ {deed.other} {deed.performative} {deed.text.removesuffix(f'[source({agent})]')}"
        case "received":
            text = deed.text.removesuffix(f"[source({deed.other})]")
            return f"← {deed.other} {deed.performative} {text}"
        case "undelivered":
            return f"not delivered to {deed.other}: {deed.performative} {deed.text}{why}"
        case "outcome":
            return f"{deed.text} {deed.state}{why}".strip()
        case "stopped":
            return f"stopped {deed.text}{why}".rstrip()
        case "operator":
            return f"the operator: {deed.text}{why}"
    return deed.text
