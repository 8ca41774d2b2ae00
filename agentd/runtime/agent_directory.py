"""The fleet's directory for the agents of a daemon: receivers of mail, agents that are online, providers of services.

Each board's `commd` keeps a directory of all agents, also those of boards that are away. It publishes changes, and is
queried at intervals, because a publication may be lost.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import AsyncExitStack, suppress
from typing import Final, Literal, TypeAlias

from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms import terms
from agentd.mind.data.effects import TeamRequestRefused
from agentd.mind.data.inputs import PerceptAdded, PerceptRemoved
from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, BusError
from commd.common.clock import Clock
from commd.common.tasks import wait_at_most
from commd.liveness.presence import Presence
from schemas.mission.access_rules import checked
from schemas.mission.model import RESERVED
from schemas.wire import keys
from schemas.wire.codec import BadRecord
from schemas.wire.records import BoardServices, ServiceRequest

START_PATIENCE: Final = 2.0
"""Wall seconds for the directories to answer at the start; later they are queried again."""
START_RETRY: Final = 0.1
ASK_EVERY: Final = 30.0
"""Wall seconds between two queries of a directory."""
ASK_AGAIN: Final = 1.0
"""The same if it did not answer: its token may be here before its queryable."""
ASK_TIMEOUT: Final = 5.0
UNREPORTED: Final = 2 * ASK_EVERY
"""Wall seconds after its last message from which the sender counts as ended, if all directories answer without it: they
have queried each other meanwhile."""
UNREPORTED_AWAY: Final = 10 * ASK_EVERY
"""The same if only some directories answer: they know the agents of boards that are away."""
PATIENCE: Final = 5.0
"""Wall seconds after which a request has failed, if the directory has answered no agent of this daemon meanwhile. A
router restarts in less."""
RETRY: Final = 0.2
"""Wall seconds between two attempts of a request."""
AT_ONCE: Final = 16
"""Requests of this daemon on their way to one board at a time; commd refuses more than 256."""
DAEMONS: Final = ("agentd", "client")
"""Daemons that hold a token for each agent."""
ONLINE, BOARD = signature("online", 1), signature("board", 1)
Do: TypeAlias = Literal["join", "leave", "register", "deregister", "search", "subscribe"]
Feed: TypeAlias = Callable[[PerceptAdded | PerceptRemoved], None]
log = logging.getLogger("agent_directory")


class AgentDirectory:
    """The agents that can be sent to, in a fixed order: the mission's first, then the others as they joined."""

    def __init__(self, bus: Bus, mission: Mapping[str, str], wall: Callable[[], float] = time.monotonic) -> None:
        """`mission` has the receivers of mail that the mission names, and their boards; `wall` returns seconds."""
        self.mission = mission
        self.names: dict[str, str] = dict(mission)
        """All agents, online or not, and their boards. The dict is never changed: another one takes its place."""
        self.on_change: list[Callable[[], None]] = []
        """Called whenever names have changed."""
        self._bus, self._wall = bus, wall
        self._services: dict[str, BoardServices] = {}
        self._here: dict[str, str] = {}
        """Agents created by this daemon, and their boards."""
        self._ended: set[str] = set()
        """Agents that this daemon has ended, until their board reports that."""
        self._met: dict[str, float] = {}
        """Senders of mail that no board has reported yet, and when the last message of each came."""
        self._remembered: dict[str, None] = {}
        """Correspondents of former lives of agents, until a board's directory has answered."""
        self._ask = asyncio.Event()

    async def watch(self, boards: Collection[str]) -> None:
        """Subscribe to all directories; return when those of `boards` have answered, at most `START_PATIENCE` later."""
        self._bus.subscribe(keys.services(self._bus.fleet, "*"), BoardServices, self._published)
        for board in boards:
            self._bus.watch(keys.alive(self._bus.fleet, board, "commd", "*"), lambda _, alive: self._ask_soon(alive))
        try:
            async with asyncio.timeout(START_PATIENCE):
                for board in boards:
                    while True:
                        if await self._refresh(board):
                            break
                        await asyncio.sleep(START_RETRY)
        except TimeoutError:
            log.warning("the directory of %s does not answer yet: only the mission's agents are known", board)

    async def follow(self, boards: Collection[str]) -> None:
        """Query the directories of `boards` at intervals and when one is back, forever."""
        pause = ASK_EVERY
        while True:
            await wait_at_most(self._ask, pause)
            self._ask.clear()
            begun = self._wall()
            answered = [await self._refresh(board) for board in boards]
            pause = ASK_EVERY if all(answered) else ASK_AGAIN
            if any(answered):
                self._forget_unreported(begun - (UNREPORTED if all(answered) else UNREPORTED_AWAY))

    def add(self, name: str, board: str) -> None:
        """Add an agent of this daemon; those of the mission are always known."""
        self._ended.discard(name)
        if name not in self.mission:
            self._here[name] = board
            self._settle()

    def remove(self, name: str) -> None:
        """Remove an agent of this daemon that has ended; those of the mission stay, for they may come back."""
        if self._here.pop(name, None) is not None:
            self._ended.add(name)
            self._settle()

    def met(self, name: str) -> None:
        """Add the sender of a message, in case the report of its board was lost."""
        if name in self._met:
            self._met[name] = self._wall()
        elif name not in self.names and name not in self._ended and name not in RESERVED:
            self._met[name] = self._wall()
            self._ask.set()
            self._settle()

    def remember(self, names: Iterable[str]) -> None:
        """Add correspondents of a former life of an agent, until a directory has answered."""
        if not self._services:
            self._remembered |= {name: None for name in names if name not in RESERVED}
            self._settle()

    def _published(self, key: str, services: BoardServices) -> None:
        """Take what a board has published, of itself alone."""
        if (parsed := keys.parse(key)) is not None and parsed[1] == services.board:
            self.update(services)

    def update(self, services: BoardServices) -> None:
        """Take the report of a board, unless it is older than the last one."""
        known = self._services.get(services.board)
        if known is not None and services.header.boot == known.header.boot and services.version <= known.version:
            return
        self._services[services.board] = services
        self._settle()

    def _settle(self) -> None:
        """Update the names; those that stay keep their places."""
        homes: dict[str, str] = {}
        secured = any(services.prefix for services in self._services.values())
        for board, services in self._services.items():
            for name in checked(services, self.mission, secured).agents:
                homes.setdefault(name, board)
        self._ended &= homes.keys()
        self._met = {name: at for name, at in self._met.items() if name not in homes}
        homes = {name: board for name, board in homes.items() if name not in self._ended} | self._here
        homes = dict.fromkeys(self._remembered, "") | homes | dict.fromkeys(self._met, "") | dict(self.mission)
        if homes == self.names:
            return
        kept = {name: homes.pop(name) for name in self.names if name in homes}
        self.names = kept | homes
        for handler in self.on_change:
            handler()

    def _forget_unreported(self, before: float) -> None:
        """Remove those whose last message came before a time."""
        self._met = {name: at for name, at in self._met.items() if at >= before}
        self._settle()

    def _ask_soon(self, there: bool) -> None:
        if there:
            self._ask.set()

    async def _refresh(self, board: str) -> bool:
        """Query a board's directory. Returns whether it has answered."""
        answered = False

        def take(_: str, services: BoardServices) -> None:
            nonlocal answered
            answered = True
            self._remembered = {}
            self.update(services)
            self._settle()

        try:
            await self._bus.ask_all(keys.services(self._bus.fleet, board), BoardServices, ASK_TIMEOUT, take)
        except BusClosed as closed:
            log.debug("not_asked board=%s why=%s", board, closed)
        if answered and self._met:
            log.info("unknown senders=%s", ",".join(self._met))
        return answered


class PresenceBeliefs:
    """The agents that are online, as beliefs `online(Agent)[board(B)]` of agents with `presence: true`.

    An agent is online while a token of its daemon is. A lost token counts after a grace period, longer if the router of
    its board is lost too (`commd.liveness.presence`): the restart of a router must not look like the end of all agents.
    """

    def __init__(self, bus: Bus, directory: AgentDirectory, clock: Clock) -> None:
        self.online: dict[str, str] = {}
        """The agents that are online, in the order of their tokens, and their boards."""
        self._bus, self._directory, self._clock = bus, directory, clock
        self._presence = Presence(None, lambda name: directory.names.get(name))
        self._here: set[str] = set()
        """The agents of this daemon: online whatever the router reports."""
        self._subscribers: dict[str, Feed] = {}
        self._changed = asyncio.Event()

    def begin(self, agent: str) -> None:
        """Note that an agent of this daemon begins."""
        self._here.add(agent)
        self._look(agent)

    def end(self, agent: str) -> None:
        """Note that an agent of this daemon has ended."""
        self._here.discard(agent)
        self._subscribers.pop(agent, None)
        self._look(agent)

    def subscribe(self, agent: str, feed: Feed) -> None:
        """Feed an agent the beliefs about agents that are online, now and at each change."""
        self._subscribers[agent] = feed
        for other, board in self.online.items():
            if other != agent:
                feed(PerceptAdded(_online(other, board)))

    async def follow(self) -> None:
        """Follow the tokens on the bus, forever."""
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
        self._directory.on_change.append(self._look_at_all)
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
        """Update all agents: the names or the router have changed."""
        for agent in self._presence.known() | self.online.keys():
            if agent not in self._directory.names and agent not in self._here:
                self._presence.forget(agent)
            self._look(agent)

    def _look(self, agent: str) -> None:
        """Feed the subscribers if an agent has come or gone. One that cannot be sent to does not count."""
        there = agent in self._here or self._presence.seems_there(agent)
        board = self._directory.names.get(agent) if there else None
        if board == self.online.get(agent):
            return
        old = self.online.pop(agent, None)
        if board is not None:
            self.online[agent] = board
        for other, feed in self._subscribers.items():
            if other != agent:
                if old is not None:
                    feed(PerceptRemoved(_online(agent, old), (0,)))
                if board is not None:
                    feed(PerceptAdded(_online(agent, board)))


def _online(agent: str, board: str) -> terms.Literal:
    annotations = (terms.Literal(BOARD, (terms.atom(board),)),) if board else ()
    return terms.Literal(ONLINE, (terms.atom(agent),), annotations)


class NotDone(TeamRequestRefused):
    """The directory has not fulfilled a request; the text says why."""

    def __init__(self, why: str, answered: bool, prefix: str = "") -> None:
        super().__init__("action_failed", why)
        self.answered = answered
        """Whether it has refused; otherwise it did not answer, and may have fulfilled the request."""
        self.prefix = prefix
        """The required beginning of names of agents created at run time."""


class _Queue:
    """The requests for the directory of one board."""

    def __init__(self) -> None:
        self.places = asyncio.Semaphore(AT_ONCE)
        self._heard = float("-inf")

    def heard(self) -> None:
        """Note that the directory has answered a request: the others may wait longer."""
        self._heard = asyncio.get_running_loop().time()

    def until(self, since: float) -> float:
        """Return the time of the event loop, in seconds, at which a request made at `since` has failed."""
        return max(since, self._heard) + PATIENCE


class Services:
    """Requests of the agents of this daemon to the directories of their boards, for each agent one at a time."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._order: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)
        self._queues: defaultdict[str, _Queue] = defaultdict(_Queue)

    async def ask(self, board: str, agent: str, do: Do, service: str = "", others: Sequence[str] = ()) -> BoardServices:
        """Send a request and return the answer; `others` leave with the agent. Raises NotDone."""
        request = ServiceRequest(agent=agent, do=do, service=service, others=tuple(others))
        loop = asyncio.get_running_loop()
        since, queue = loop.time(), self._queues[board]
        answer, why = None, "those before it have had no answer either"
        async with AsyncExitStack() as held:
            if await self._turn(held, (self._order[agent], queue.places), queue, since):
                until = queue.until(since)
                while answer is None and (left := until - loop.time()) > 0:
                    answer, why = await self._ask(board, request, left)
                    if answer is None:
                        await asyncio.sleep(min(RETRY, left))
                    else:
                        queue.heard()
        if answer is None:
            raise NotDone(f"the directory of board {board} does not answer: {why}", False)
        if answer.problem:
            raise NotDone(answer.problem, True, answer.prefix)
        return answer

    def done_with(self, agent: str) -> None:
        """Forget an agent that has ended."""
        self._order.pop(agent, None)

    async def _turn(
        self, held: AsyncExitStack, gates: Iterable[asyncio.Lock | asyncio.Semaphore], queue: _Queue, since: float
    ) -> bool:
        """Wait for the turn of a request, which `held` then holds; False if the directory does not answer."""
        loop = asyncio.get_running_loop()
        for gate in gates:
            entered = False
            while not entered:
                if loop.time() >= (until := queue.until(since)):
                    return False
                with suppress(TimeoutError):
                    async with asyncio.timeout_at(until):
                        await held.enter_async_context(gate)
                        entered = True
        return True

    async def _ask(self, board: str, request: ServiceRequest, seconds: float) -> tuple[BoardServices | None, str]:
        key = keys.service_requests(self._bus.fleet, board, request.agent)
        try:
            return await self._bus.ask_one(key, request, BoardServices, seconds), ""
        except (BusError, BadRecord) as error:
            return None, str(error)
