"""Actions and their outcomes, from the statuses that bridges publish."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal

from argosy.cli.journal import Level
from argosy.fleet_model.lives import Lives
from argosy.fleet_model.members import Roster
from argosy.fleet_model.robots import Tell
from schemas.humanize import LONGEST, printable, shortened
from schemas.liveness import ACTION_ASKED_AGAIN, ACTION_GIVEN_UP
from schemas.wire.records import ActionStatus, State
from schemas.wire.term_text import write
from schemas.wire.terms import Structure, Term

KEPT_ACTIONS = 2_000
"""Actions kept; older ones are only counted."""
MAX_FIGURES = 20
"""Figures of an action's feedback that are kept."""


@dataclass
class ActionSeen:
    """An action and its outcome. Times are seconds of the observer's clock."""

    id: str
    agent: str
    text: str
    """As the agent would write it: `goto(-27.6,-48.5,40)`."""
    name: str
    parameters: tuple[Term, ...]
    began: float
    state: State | Literal["unknown"]
    """`unknown`: no outcome was published, and whoever could publish it is gone."""
    reason: str = ""
    feedback: dict[str, float] = field(default_factory=dict)
    ended: float | None = None
    heard: float = 0.0
    """Time of its last status."""
    joined: bool = False
    """It had begun before it was first heard, at `began`: its age is the least that it can be."""

    def silent(self, now: float) -> float | None:
        """Return the seconds since its last status; None if it has ended, or the status is fresh."""
        age = now - self.heard
        return age if self.ended is None and age > ACTION_ASKED_AGAIN else None

    def age(self, now: float) -> float:
        """Return how long it took, or has taken until now, in seconds."""
        return (now if self.ended is None else self.ended) - self.began


class ActionsSeen:
    """The actions of a fleet by id, the oldest first."""

    def __init__(self) -> None:
        self.by_id: dict[str, ActionSeen] = {}
        self.forgotten = 0
        self._open: dict[str, dict[str, ActionSeen]] = {}
        """Actions without a final state, by agent and id."""

    def open(self, agent: str | None = None) -> list[ActionSeen]:
        """Return the actions that have no final state yet, of one agent or of all, the oldest first."""
        those = self._open.values() if agent is None else (self._open.get(agent, {}),)
        found = [one for each in those for one in each.values() if one.ended is None]
        return found if agent is not None else sorted(found, key=lambda one: one.began)

    def held(self) -> ActionsSeen:
        """Return a copy that later statuses do not change."""
        held = ActionsSeen()
        held.by_id = {id: copy(action) for id, action in self.by_id.items()}
        held._open = {agent: {id: held.by_id[id] for id in those} for agent, those in self._open.items()}
        held.forgotten = self.forgotten
        return held

    def status(self, agent: str, status: ActionStatus, now: float, tell: Tell, speed: float = 1.0) -> ActionSeen | None:
        """Take a status of an action. Returns the action, or None if it had ended already.

        `speed` is in mission seconds per second of `now`: durations are reported in mission seconds.
        """
        id = shortened(status.id)
        seen = self.by_id.get(id)
        if seen is None:
            text = shortened(write(Structure(status.name, status.parameters)))
            parameters = status.parameters if len(text) < LONGEST else ()  # too long to keep
            seen = ActionSeen(id, agent, text, shortened(status.name), parameters, now, status.state)
            seen.joined = status.state not in ("accepted", "refused")
            self._keep(seen)
            if not status.final:
                tell(agent, text, "action")
        if seen.ended is not None and seen.state != "unknown":
            return None
        if seen.ended is not None:  # it is reported again
            seen.ended = None
            self._open.setdefault(seen.agent, {})[seen.id] = seen
        seen.state, seen.reason, seen.heard = status.state, shortened(status.reason), now
        figures = ((printable(name[:LONGEST]), value) for name, value in status.feedback.items())
        seen.feedback = dict(islice(figures, MAX_FIGURES)) or seen.feedback
        if status.final:
            self.end(seen, status.state, seen.reason, now)
            why = f": {seen.reason}" if seen.reason else ""
            level: Level = "good" if status.state == "succeeded" else "warning"
            took = f"{'more than ' * seen.joined}{seen.age(now) * speed:.1f} s"
            tell(agent, f"{seen.text} {status.state} after {took}{why}", level)
        return seen

    def end(self, action: ActionSeen, state: State | Literal["unknown"], reason: str, now: float) -> None:
        """End an action at `now`, in model seconds; `unknown` if its outcome will not be reported."""
        action.state, action.reason, action.ended = state, shortened(reason), now
        self._close(action)

    def forget(self, before: float) -> None:
        """Forget the actions whose last status is older than `before`, in model seconds."""
        for id, action in list(self.by_id.items()):
            if action.heard < before:
                del self.by_id[id]
                self._close(action)

    def _close(self, action: ActionSeen) -> None:
        those = self._open.get(action.agent, {})
        those.pop(action.id, None)
        if not those:
            self._open.pop(action.agent, None)

    def _keep(self, action: ActionSeen) -> None:
        if len(self.by_id) >= KEPT_ACTIONS:
            self._close(self.by_id.pop(next(iter(self.by_id))))
            self.forgotten += 1
        self.by_id[action.id] = action
        self._open.setdefault(action.agent, {})[action.id] = action


def why_unknown(action: ActionSeen, roster: Roster, lives: Lives, now: float) -> str:
    """Return why the outcome of an action will not be reported; empty while it still may be. `now`: model seconds."""
    silent = action.silent(now)
    if silent is None:
        return ""
    agent = roster.agents.get(action.agent) or roster.clients.get(action.agent)
    if agent is not None and not agent.there:
        return "its agent is gone"
    if lives.began(action.agent, "agentd") > action.heard:
        return "its agent was restarted"
    bridges = [one for one in roster.robots.values() if action.agent in one.agents]
    if bridges and not any(one.there for one in bridges):
        return "its bridge is gone"
    if any(lives.began(one.name, "bridged") > action.heard for one in bridges):
        return "its bridge was restarted"
    return f"no status for {ACTION_GIVEN_UP:.0f} s" if silent > ACTION_GIVEN_UP else ""
