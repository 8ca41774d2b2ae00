"""Whether the agents of a robot are alive, as far as their tokens tell (design section 9).

A token that is missing proves a death only through a live router: when the router restarts, every token goes and comes
back. Pure: token and router events and wall seconds go in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

AGENT_GRACE = 1.0
"""Wall seconds for which a token must be missing while the router answers."""
ROUTER_GRACE = 5.0
"""Wall seconds that an agent has to come back after the router did: each daemon reconnects at its own pace."""
BUS_GRACE = 5.0
"""Wall seconds without a router after which the agents count as lost: nobody could tell the robot anything."""


class Presence:
    """The tokens of a robot's agents. An agent that never came cannot be lost, unless it is expected."""

    def __init__(self, agents: Iterable[str]) -> None:
        self._tokens: dict[str, set[str]] = {agent: set() for agent in agents}
        self._absent_since: dict[str, float] = {}
        self._expected: dict[str, float] = {}
        """Of those that are absent since the start: until when they may come."""
        self._router_since = -math.inf
        self._router_up = True

    def expect(self, agent: str, wall: float) -> None:
        """An agent was there in a former life of the bridge: it is absent until it comes, and may be lost."""
        if agent in self._tokens:
            self._absent_since[agent], self._expected[agent] = wall, wall + ROUTER_GRACE

    def token(self, agent: str, boot: str, alive: bool, wall: float) -> None:
        """A token came or went."""
        tokens = self._tokens.get(agent)
        if tokens is None:
            return
        if alive:
            tokens.add(boot)
            self._absent_since.pop(agent, None)
            self._expected.pop(agent, None)
        elif boot in tokens:
            tokens.discard(boot)
            if not tokens:
                self._absent_since[agent] = wall

    def router(self, up: bool, wall: float) -> None:
        """The connection to the router came or went."""
        if up != self._router_up:
            self._router_up, self._router_since = up, wall

    def lost(self, wall: float) -> dict[str, str]:
        """The agents that were there and are no more, each with the reason in words."""
        if not self._router_up:
            if wall - self._router_since < BUS_GRACE:
                return {}
            return dict.fromkeys(sorted(self.known()), f"no router for {wall - self._router_since:.0f} s")
        return {
            agent: "it has not come back since the bridge did" if agent in self._expected else "its token is gone"
            for agent, since in self._absent_since.items()
            if wall >= self._expected.get(agent, since + AGENT_GRACE)
            and (since > self._router_since or wall - self._router_since >= ROUTER_GRACE)
        }

    @property
    def complete(self) -> bool:
        """Whether somebody came, nobody is missing and the router is there: only an event can change what holds."""
        return self._router_up and not self._absent_since and any(self._tokens.values())

    def there(self) -> set[str]:
        """The agents that are there."""
        return {agent for agent, tokens in self._tokens.items() if tokens}

    def known(self) -> set[str]:
        """The agents that are there, or were."""
        return {agent for agent, tokens in self._tokens.items() if tokens or agent in self._absent_since}
