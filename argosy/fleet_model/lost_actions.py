"""Actions of which nobody tells any more: whoever looks on must not take them for running."""

from __future__ import annotations

from argosy.fleet_model.robots import ActionSeen
from argosy.fleet_model.roster import Roster
from schemas.liveness import ACTION_GIVEN_UP

MOST = 2_000
"""Names whose present lives are kept."""


class Lives:
    """When the present life of each agent and bridge began, by the tokens that they hold."""

    def __init__(self) -> None:
        self._boots: dict[tuple[str, str], tuple[str, float]] = {}

    def token(self, name: str, daemon: str, boot: str, now: float) -> bool:
        """A daemon holds a name. Returns whether this is another life of it than the one that was seen before."""
        known = self._boots.pop((name, daemon), (boot, 0.0))
        anew = known[0] != boot
        self._boots[name, daemon] = (boot, now) if anew else known
        if len(self._boots) > MOST:
            del self._boots[next(iter(self._boots))]
        return anew

    def began(self, name: str, daemon: str) -> float:
        """Return when this life began, if another one was seen before; else 0."""
        return self._boots.get((name, daemon), ("", 0.0))[1]


def why_unknown(action: ActionSeen, roster: Roster, lives: Lives, now: float) -> str:
    """Return why nobody will tell how an action ends; empty as long as somebody may."""
    silent = action.silent(now)
    if silent is None:
        return ""
    agent = roster.agents.get(action.agent) or roster.clients.get(action.agent)
    if agent is not None and not agent.there:
        return "its agent is gone"
    if lives.began(action.agent, "agentd") > action.heard:
        return "its agent was started anew"
    bridges = [one for one in roster.robots.values() if action.agent in one.agents]
    if bridges and not any(one.there for one in bridges):
        return "its bridge is gone"
    if any(lives.began(one.name, "bridged") > action.heard for one in bridges):
        return "its bridge was started anew"
    return f"nobody has told of it for {ACTION_GIVEN_UP:.0f} s" if silent > ACTION_GIVEN_UP else ""
