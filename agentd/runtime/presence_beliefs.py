"""Who else is there: beliefs `online(Agent)[board(B)]` for the agents that ask for them (`presence: true`).

An agent is there while a token of its daemon is. That a token goes counts only after a moment, and later still if the
router of its board goes too (`commd.liveness.presence`): a router that restarts shall not look like the death of all
agents.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom
from agentd.mind.data.inputs import Input, PerceptAdded, PerceptRemoved
from agentd.runtime.agent_directory import AgentDirectory
from commd.bus.bus import Bus
from commd.common.clock import Clock
from commd.common.tasks import wait_at_most
from commd.liveness.presence import Presence
from schemas.wire import keys

ONLINE, BOARD = signature("online", 1), signature("board", 1)
DAEMONS = ("agentd", "client")
"""Whose tokens stand for agents."""


class PresenceBeliefs:
    """The agents that are there, and those of this daemon that want to know."""

    def __init__(self, bus: Bus, roster: AgentDirectory, clock: Clock) -> None:
        self.online: dict[str, str] = {}
        """Those that are there, as they came, and their boards."""
        self._bus, self._roster, self._clock = bus, roster, clock
        self._presence = Presence(None, roster.names.get)
        self._here: set[str] = set()
        """The agents of this daemon: they are there whatever the router says."""
        self._curious: dict[str, Callable[[Input], None]] = {}
        self._changed = asyncio.Event()

    def begin(self, agent: str) -> None:
        """An agent of this daemon begins."""
        self._here.add(agent)
        self._look(agent)

    def end(self, agent: str) -> None:
        """An agent of this daemon has ended."""
        self._here.discard(agent)
        self._curious.pop(agent, None)
        self._look(agent)

    def tell(self, agent: str, feed: Callable[[Input], None]) -> None:
        """From now on feed an agent who is there: all that are, and each that comes or goes."""
        self._curious[agent] = feed
        for other, board in self.online.items():
            if other != agent:
                feed(PerceptAdded(_online(other, board)))

    async def follow(self) -> None:
        """Follow the tokens on the bus, for ever."""
        fleet, clock, presence = self._bus.fleet, self._clock, self._presence

        def agent_token(key: str, alive: bool) -> None:
            if (parsed := keys.parse(key)) is not None:
                presence.token(parsed[1], parsed[2][-1], alive, clock.wall())
                if alive:
                    self._look(parsed[1])
                self._changed.set()

        def board_token(key: str, alive: bool) -> None:
            if (parsed := keys.parse(key)) is not None:
                presence.board(parsed[1], parsed[2][-1], alive, clock.wall())
                self._changed.set()

        def router(up: bool) -> None:
            presence.router(up, clock.wall())
            self._look_at_all()
            self._changed.set()

        self._bus.on_router(router)
        self._roster.on_change.append(self._look_at_all)
        self._bus.watch(keys.alive(fleet, "*", "commd", "*"), board_token)
        for daemon in DAEMONS:
            self._bus.watch(keys.alive(fleet, "*", daemon, "*"), agent_token)
        while True:
            for agent in presence.lost(clock.wall()):
                if agent in self.online:
                    self._look(agent)
            pause = presence.due - clock.wall()
            await wait_at_most(self._changed, None if pause == float("inf") else max(0.0, pause))
            self._changed.clear()

    def _look_at_all(self) -> None:
        """The roster or the router has changed: agents may have become known, have ended for good, or be lost."""
        for agent in self._presence.known() | self.online.keys():
            if agent not in self._roster.names and agent not in self._here:
                self._presence.forget(agent)
            self._look(agent)

    def _look(self, agent: str) -> None:
        """Tell those who want to know if an agent has come or gone. Who cannot be sent to is nobody."""
        there = agent in self._here or self._presence.seems_there(agent)
        board = self._roster.names.get(agent) if there else None
        if board == self.online.get(agent):
            return
        old = self.online.pop(agent, None)
        if board is not None:
            self.online[agent] = board
        for other, feed in self._curious.items():
            if other != agent:
                if old is not None:
                    feed(PerceptRemoved(_online(agent, old), (0,)))
                if board is not None:
                    feed(PerceptAdded(_online(agent, board)))


def _online(agent: str, board: str) -> Literal:
    annotations = (Literal(BOARD, (atom(board),)),) if board else ()
    return Literal(ONLINE, (atom(agent),), annotations)
