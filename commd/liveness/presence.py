"""Whether agents are alive, as far as their liveliness tokens tell (design section 9).

A token that is missing proves a death only through a live router: when a router restarts, the tokens of its board go
and come back, and when the own one does, all go. Pure: token and router events and wall seconds go in.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from schemas.liveness import AGENT_GRACE, BUS_GRACE, FIRST_HEALTH, ROUTER_GRACE, SILENT_AFTER


class Presence:
    """The tokens of some agents (None: of all that come). Who never came cannot be lost, unless it is expected.

    An agent that is lost stays so until a token of it comes. `board_of` says on which board an agent lives: one that
    goes together with its board's `commd` may only have lost its router, or the link to us.
    """

    def __init__(
        self,
        agents: Iterable[str] | None = None,
        board_of: Callable[[str], str | None] = lambda _: None,
        grace: float = AGENT_GRACE,
    ) -> None:
        """`grace`: wall seconds for which a token must be missing while the routers answer."""
        self._grace = grace
        self._agents = None if agents is None else frozenset(agents)
        self._board_of = board_of
        self._tokens: dict[str, set[str]] = {}
        """Those that are there now; none is empty."""
        self._absent_since: dict[str, float] = {}
        self._expected: dict[str, float] = {}
        """Of those that are absent since the start: until when they may come."""
        self._lost: dict[str, str] = {}
        self._boards: dict[str, set[str]] = {}
        self._board_since: dict[str, float] = {}
        """When the `commd` of a board came or went last, if it ever went."""
        self._router_since = -math.inf
        self._router_up = True

    def expect(self, agent: str, wall: float) -> None:
        """An agent was there in a former life of ours: it is absent until it comes, and may be lost."""
        if self._watches(agent):
            self._absent_since[agent], self._expected[agent] = wall, wall + ROUTER_GRACE

    def token(self, agent: str, boot: str, alive: bool, wall: float) -> None:
        """A token of an agent came or went."""
        if not self._watches(agent):
            return
        tokens = self._tokens.get(agent)
        if alive:
            self._tokens.setdefault(agent, set()).add(boot)
            for known in (self._absent_since, self._expected, self._lost):
                known.pop(agent, None)
        elif tokens is not None and boot in tokens:
            tokens.discard(boot)
            if not tokens:
                del self._tokens[agent]
                self._absent_since[agent] = wall

    def board(self, board: str, boot: str, alive: bool, wall: float) -> None:
        """The token of a board's `commd` came or went."""
        boots = self._boards.setdefault(board, set())
        there = bool(boots)
        if alive:
            boots.add(boot)
        else:
            boots.discard(boot)
        if there != bool(boots) and (there or board in self._board_since):
            self._board_since[board] = wall

    def router(self, up: bool, wall: float) -> None:
        """The connection to our own router came or went."""
        if up != self._router_up:
            self._router_up, self._router_since = up, wall
            if up:
                self._lost = {agent: why for agent, why in self._lost.items() if agent not in self._tokens}

    def forget(self, agent: str) -> None:
        """An agent that is absent has ended for good: it is not lost either."""
        if agent not in self._tokens:
            for known in (self._absent_since, self._expected, self._lost):
                known.pop(agent, None)

    def lost(self, wall: float) -> dict[str, str]:
        """The agents that were there and are no more, each with the reason in words."""
        if not self._router_up and wall >= self._router_since + BUS_GRACE:
            for agent in sorted(self.known() - set(self._lost)):
                self._lost[agent] = f"no router for {wall - self._router_since:.0f} s"
        for agent in self._absent_since:
            if agent not in self._lost and wall >= self._lost_at(agent):
                late = agent in self._expected
                self._lost[agent] = "it has not come back since the bridge did" if late else "its token is gone"
        return dict(self._lost)

    @property
    def due(self) -> float:
        """When the next agent is lost, in wall seconds, if nothing happens until then; infinite if none is."""
        waiting = [self._lost_at(agent) for agent in self._absent_since if agent not in self._lost]
        if not self._router_up and len(self._lost) < len(self.known()):
            waiting.append(self._router_since + BUS_GRACE)
        return min(waiting, default=math.inf)

    def _lost_at(self, agent: str) -> float:
        """When an absent agent is lost, as things are now."""
        if not self._router_up:
            return self._router_since + BUS_GRACE
        since = self._absent_since[agent]
        at = self._expected.get(agent, since + self._grace)
        if since <= self._router_since:
            at = max(at, self._router_since + ROUTER_GRACE)
        board = self._board_of(agent)
        if board is not None and board in self._board_since:
            if not self._boards[board]:
                at = max(at, since + ROUTER_GRACE)
            elif since <= self._board_since[board]:
                at = max(at, self._board_since[board] + ROUTER_GRACE)
        return at

    @property
    def complete(self) -> bool:
        """Whether somebody came, nobody is missing and the router is there: only an event can change what holds."""
        return self._router_up and not self._absent_since and bool(self._tokens)

    def there(self) -> set[str]:
        """The agents that are there."""
        return set(self._tokens)

    def seems_there(self, agent: str) -> bool:
        """Whether an agent is there, or was when one looked last and is not lost yet."""
        return agent not in self._lost and (agent in self._tokens or agent in self._absent_since)

    def known(self) -> set[str]:
        """The agents that are there, or were."""
        return self._tokens.keys() | self._absent_since.keys()

    def _watches(self, agent: str) -> bool:
        return self._agents is None or agent in self._agents


STALL = 1.5
"""Wall seconds between two looks of ours after which it may be us who have not listened."""
CATCH_UP = 2.0
"""Wall seconds that others then have at least: their words wait to be heard."""


class Silence:
    """Tells which daemons say nothing. Who has no token is not found silent, but one that was stays so without it."""

    def __init__(self, patience: float = SILENT_AFTER) -> None:
        """`patience`: wall seconds that a daemon may be silent between two words."""
        self.patience = patience
        self._until: dict[tuple[str, str], float] = {}
        """By name and boot: when it is to have spoken at the latest."""
        self._spoke: dict[str, str] = {}
        """The boot under which each has spoken last."""
        self._hung: dict[str, str] = {}
        """Those that say nothing, with their boot; they do so until they speak, or another life of them comes."""
        self._looked = float("inf")

    def token(self, name: str, boot: str, alive: bool, wall: float) -> None:
        """The token of a daemon came or went."""
        if not alive:
            self._until.pop((name, boot), None)
            return
        first = self._spoke.get(name) != boot
        self._until[name, boot] = wall + (max(self.patience, FIRST_HEALTH) if first else self.patience)
        if self._hung.get(name) != boot:
            self._hung.pop(name, None)

    def word(self, name: str, boot: str, wall: float) -> None:
        """A daemon has put its health."""
        if (name, boot) in self._until:
            self._until[name, boot], self._spoke[name] = wall + self.patience, boot
            self._hung.pop(name, None)

    def excuse(self, wall: float, seconds: float) -> None:
        """We may have missed words: nobody falls silent for some time."""
        for life, until in self._until.items():
            self._until[life] = max(until, wall + seconds)

    def silent(self, wall: float) -> list[str]:
        """Return who says nothing. To be asked about twice a second: after a longer pause it was we who slept."""
        if wall - self._looked > STALL:
            self.excuse(wall, CATCH_UP)
        self._looked = wall
        latest: dict[str, tuple[float, str]] = {}
        for (name, boot), until in self._until.items():  # of two lives that overlap the new one speaks
            latest[name] = max((until, boot), latest.get(name, (until, boot)))
        self._hung |= {name: boot for name, (until, boot) in latest.items() if wall >= until}
        return list(self._hung)
