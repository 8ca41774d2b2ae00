"""Judge who is alive, by liveliness tokens (`Presence`) and health records (`Silence`). Pure: events and wall seconds
go in.

A missing token proves a death only through a live router: when a router restarts, the tokens of its board end and come
back, and when our own does, all end. A token alone proves no life: Zenoh's threads hold it while the event loop hangs
in a function that does not return. The health record that the loop puts once a second does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

from schemas.liveness import AGENT_GRACE, BUS_GRACE, FIRST_HEALTH, ROUTER_GRACE, SILENT_AFTER


class Tokens(dict[str, set[str]]):
    """The present liveliness tokens of each name that has any."""

    def note(self, name: str, token: str, alive: bool) -> bool:
        """Note that a token appeared or ended. Returns whether the name appeared or ended with it."""
        there = name in self
        if alive:
            self.setdefault(name, set()).add(token)
        elif there:
            self[name].discard(token)
            if not self[name]:
                del self[name]
        return there != (name in self)


class Presence:
    """The tokens of some agents (None: of all). An agent that never appeared cannot be lost, unless it is expected.

    All times are those of one clock, in wall seconds. A lost agent stays so until its token appears. `board_of` returns
    an agent's board: an agent that disappears together with its board's `commd` may only have lost its router, or the
    link to us.
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
        self._tokens = Tokens()
        self._absent_since: dict[str, float] = {}
        self._expected: dict[str, float] = {}
        """Of agents that are absent since the start: until when they may appear."""
        self._lost: dict[str, str] = {}
        self._boards = Tokens()
        self._board_since: dict[str, float] = {}
        """When the `commd` of a board last appeared or ended, if it ever ended."""
        self._router_since = -math.inf
        self._router_up = True

    def expect(self, agent: str, wall: float) -> None:
        """Expect an agent that was here before this process: from `wall` seconds on it is absent, and may be lost.

        One that is known already is judged as it is.
        """
        if self._watches(agent) and agent not in self.known():
            self._absent_since[agent], self._expected[agent] = wall, wall + ROUTER_GRACE

    def token(self, agent: str, boot: str, alive: bool, wall: float) -> None:
        """Note that a token of an agent appeared or ended at `wall` seconds."""
        if not self._watches(agent):
            return
        changed = self._tokens.note(agent, boot, alive)
        if alive:
            for known in (self._absent_since, self._expected, self._lost):
                known.pop(agent, None)
        elif changed:
            self._absent_since[agent] = wall

    def board(self, board: str, boot: str, alive: bool, wall: float) -> None:
        """Note that the token of a board's `commd` appeared or ended."""
        if self._boards.note(board, boot, alive) and (not alive or board in self._board_since):
            self._board_since[board] = wall

    def router(self, up: bool, wall: float) -> None:
        """Note that the connection to our own router was made or lost at `wall` seconds."""
        if up != self._router_up:
            self._router_up, self._router_since = up, wall
            if up:
                self._lost = {agent: why for agent, why in self._lost.items() if agent not in self._tokens}

    def forget(self, agent: str) -> None:
        """Forget an absent agent that has ended for good."""
        if agent not in self._tokens:
            for known in (self._absent_since, self._expected, self._lost):
                known.pop(agent, None)

    def lost(self, wall: float) -> dict[str, str]:
        """Return the agents that are lost at `wall` seconds, each with the reason for people."""
        if not self._router_up and wall >= self._router_since + BUS_GRACE:
            for agent in sorted(self.known() - set(self._lost)):
                self._lost[agent] = f"no router for {wall - self._router_since:.0f} s"
        for agent in self._absent_since:
            if agent not in self._lost and wall >= self._lost_at(agent):
                late = agent in self._expected
                self._lost[agent] = "it has not come back since the bridge restarted" if late else "no liveliness token"
        return dict(self._lost)

    @property
    def due(self) -> float:
        """The time at which the next agent is lost, in wall seconds, if nothing happens until then; infinite if
        none."""
        waiting = [self._lost_at(agent) for agent in self._absent_since if agent not in self._lost]
        if not self._router_up and len(self._lost) < len(self.known()):
            waiting.append(self._router_since + BUS_GRACE)
        return min(waiting, default=math.inf)

    def _lost_at(self, agent: str) -> float:
        """Return when an absent agent is lost, as things are now."""
        if not self._router_up:
            return self._router_since + BUS_GRACE
        since = self._absent_since[agent]
        at = self._expected.get(agent, since + self._grace)
        if since <= self._router_since:
            at = max(at, self._router_since + ROUTER_GRACE)
        board = self._board_of(agent)
        if board is not None and board in self._board_since:
            if board not in self._boards:
                at = max(at, since + ROUTER_GRACE)
            elif since <= self._board_since[board]:
                at = max(at, self._board_since[board] + ROUTER_GRACE)
        return at

    @property
    def complete(self) -> bool:
        """Whether an agent is present, none is missing and the router is up: only an event can change the judgement."""
        return self._router_up and not self._absent_since and bool(self._tokens)

    def there(self) -> set[str]:
        """Return the present agents."""
        return set(self._tokens)

    def seems_there(self, agent: str) -> bool:
        """Return whether an agent is present, or absent and not lost yet."""
        return agent not in self._lost and (agent in self._tokens or agent in self._absent_since)

    def known(self) -> set[str]:
        """Return the agents that are present or absent."""
        return self._tokens.keys() | self._absent_since.keys()

    def _watches(self, agent: str) -> bool:
        return self._agents is None or agent in self._agents


STALL = 1.5
"""Wall seconds between two checks after which this process itself may have been stopped."""
CATCH_UP = 2.0
"""Wall seconds that others then have at least: their records wait to be read."""


class Silence:
    """Finds daemons that are silent: alive by their token, without health records. A silent one stays so without its
    token. All times are those of one clock, in wall seconds."""

    def __init__(self, patience: float = SILENT_AFTER) -> None:
        """`patience`: wall seconds between two health records at most."""
        self.patience = patience
        self._until: dict[tuple[str, str], float] = {}
        """By name and boot: when the next health record is due."""
        self._spoke: dict[str, str] = {}
        """The boot of the last health record of each."""
        self._hung: dict[str, str] = {}
        """Silent daemons with their boots, until a health record, or a new process with that name."""
        self._looked = float("inf")

    def token(self, name: str, boot: str, alive: bool, wall: float) -> None:
        """Note that the token of a daemon appeared or ended at `wall` seconds."""
        if not alive:
            self._until.pop((name, boot), None)
            return
        first = self._spoke.get(name) != boot
        self._until[name, boot] = wall + (max(self.patience, FIRST_HEALTH) if first else self.patience)
        if self._hung.get(name) != boot:
            self._hung.pop(name, None)

    def word(self, name: str, boot: str, wall: float) -> None:
        """Note a health record that arrived at `wall` seconds."""
        if (name, boot) in self._until:
            self._until[name, boot], self._spoke[name] = wall + self.patience, boot
            self._hung.pop(name, None)

    def excuse(self, wall: float, seconds: float) -> None:
        """Extend all due times to `seconds` from now at least: this process may have missed records."""
        for life, until in self._until.items():
            self._until[life] = max(until, wall + seconds)

    def silent(self, wall: float) -> list[str]:
        """Return the silent daemons. To be called about twice a second: a longer pause is this process's own."""
        if wall - self._looked > STALL:
            self.excuse(wall, CATCH_UP)
        self._looked = wall
        latest: dict[str, tuple[float, str]] = {}
        for (name, boot), until in self._until.items():  # of two processes that overlap the new one counts
            latest[name] = max((until, boot), latest.get(name, (until, boot)))
        self._hung |= {name: boot for name, (until, boot) in latest.items() if wall >= until}
        return list(self._hung)
