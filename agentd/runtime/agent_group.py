"""The agents of one daemon: those of the mission, and those that they create at run time.

Fulfils what minds ask of their team (`TeamRequest`): create, clone and kill agents, include and save files, use the
directory of services. An agent created at run time runs in the daemon of its creator.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial, partialmethod
from pathlib import Path
from typing import Any

from agentd.extensions.file_access import AgentFiles, NotAllowed
from agentd.language.compiler.compile import CompiledProgram, DirectiveError, compile_program
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.terms.terms import EMPTY, atom, make_list
from agentd.mail.neighbours import Neighbours
from agentd.mind.data.effects import StopTeam, TeamRequest, TeamRequestRefused
from agentd.mind.data.inputs import TeamReply
from agentd.persistence.checkpoint import Synchronous
from agentd.persistence.group_commit import GroupCommit
from agentd.persistence.restore import RestoredState, forget_name, open_state
from agentd.runtime.agent_directory import AgentDirectory, Do, NotDone, PresenceBeliefs, Services
from agentd.runtime.agent_host import AgentHost
from agentd.runtime.program_loader import Part
from agentd.trace.initial_state import Sources
from agentd.trace.input_records import Included
from agentd.trace.publisher import TraceSubscribers
from commd.bus.bus import Bus, Query, Token
from commd.bus.errors import AlreadyRunning, BusClosed
from commd.client.manual_percepts import HandPerceptSubscription
from commd.common.clock import Clock
from commd.common.tasks import Tasks, in_step, wait_at_most
from commd.process.output import stdout
from commd.process.process import Agents, report_health
from commd.process.systemd import Member, Unit
from schemas.mission.access_rules import MailRights
from schemas.mission.model import RESERVED, Mission
from schemas.wire import keys
from schemas.wire.keys import check_name
from schemas.wire.records import BoardServices, Health, Mailboxes

MOST_MADE = 50
"""Agents created at run time that one daemon runs at a time."""
TURN = 1.0
"""Wall seconds at most between two checks for agents created meanwhile that have ended."""
LEAVING = 1.0
"""Wall seconds for the directory to remove an agent when the daemon ends; later it does so by itself."""
ENDING = 5.0
"""Wall seconds for a killed agent to leave before its killer continues."""
QUEUES = 1_000
"""Queues of mail between the agents that are listed."""
MOST_TRIES = 100
"""Names that are tried for an agent if the wanted one is taken."""
log = logging.getLogger("agent_group")


class AgentGroup:
    """Runs the agents of a daemon until each has ended, and answers their requests."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        mission: Mission,
        state: Path,
        seed: int,
        *,
        fresh: bool = False,
        unit: Member | None = None,
    ) -> None:
        """`state` has a folder for each agent; `fresh`: the agents begin without what is saved there.

        `seed`, any integer, is where the agents' random numbers start (`Part.own_seed`).
        """
        self._unit = unit or Unit({}).member("agentd")
        self.hosts: dict[str, AgentHost] = {}
        self.stopped: StopTeam | None = None
        """The effect by which a program has stopped the team."""
        self.directory = AgentDirectory(bus, mission.mailboxes)
        self._bus, self._clock, self._mission, self._state, self._seed = bus, clock, mission, state, seed
        self._made: dict[str, None] = {}
        self._homes: dict[str, str] = {}
        """The boards of the agents of this daemon."""
        self._ends: dict[str, asyncio.Event] = {}
        self._running: dict[asyncio.Task[None], str] = {}
        self._ended = asyncio.Event()
        """Set when an agent has ended."""
        self._reasoning: dict[str, AgentHost] = {}
        self._beginning: dict[str, asyncio.Task[None]] = {}
        """By board: what removes the services of former lives; it ends within the patience of a request."""
        self._stop = asyncio.Event()
        self._services = Services(bus)
        self._subscribers = TraceSubscribers(bus)
        self._by_hand = HandPerceptSubscription(bus)
        self._presence_beliefs = PresenceBeliefs(bus, self.directory, clock)
        self._work = Tasks("working for the agents")
        self._fresh = fresh
        self._writer = ThreadPoolExecutor(1, "checkpoint")
        """Writes the checkpoint of the agents."""
        self._commits = GroupCommit(None, self._writer)
        self._neighbours = Neighbours()

    async def add(self, *parts: Part) -> None:
        """Join the bus under the names of agents of the mission. They begin to reason in `run`.

        Raises AlreadyRunning, BusClosed and CheckpointError.
        """
        tokens = await self._bus.claim_all([part.name for part in parts])
        kept = await self._restored([part.name for part in parts])
        for part in parts:
            self._house(part, self._mission.agents[part.name].board, tokens[part.name], kept.get(part.name))

    def _house(self, part: Part, board: str, token: Token, memory: RestoredState | None = None) -> AgentHost:
        rights = MailRights(self._mission, part.name, board)
        daemon = self._subscribers, self._by_hand, self._commits, self._neighbours
        host = AgentHost(self._bus, self._clock, part, self.directory, self, token, *daemon, memory, rights)
        self.hosts[part.name] = host
        self._homes[part.name] = board
        self.directory.add(part.name, board)
        return host

    async def _restored(self, names: list[str]) -> dict[str, RestoredState]:
        """Open the checkpoint; return the state of each agent of the mission that is kept. Raises CheckpointError."""
        fresh = [name for name in names if self._mission.agents[name].on_restart == "fresh"]
        kept = [name for name in names if name not in fresh]
        forgotten = names if self._fresh else fresh
        synchronous: Synchronous = "FULL" if self._mission.mail.synchronous == "full" else "NORMAL"
        work = partial(open_state, self._state, self._bus.name, kept, forgotten, synchronous)
        checkpoint, states = await asyncio.get_running_loop().run_in_executor(self._writer, work)
        self._commits = GroupCommit(checkpoint, self._writer)
        return states

    async def run(self, stop: asyncio.Event) -> None:
        """Run the agents until `stop` is set or a program stops the team. Raises AccessDenied."""
        boards = sorted(set(self._homes.values()))
        try:
            await self._bus.permitted(puts=[keys.health(self._bus.fleet, board, self._bus.daemon) for board in boards])
        except BusClosed:
            self._writer.shutdown(wait=False)
            raise
        await self.directory.watch(boards)
        self._work.spawn(self.directory.follow(boards))
        if any(host.part.presence for host in self.hosts.values()):
            self._work.spawn(self._presence_beliefs.follow())
        self._bus.on_router(self._retry_mail)
        for board in boards:
            self._bus.watch(keys.alive(self._bus.fleet, board, "commd", "*"), lambda _, alive: self._retry_mail(alive))
        for board in boards:
            beginners = [name for name, host in self.hosts.items() if host.begins and self._homes[name] == board]
            if beginners:
                self._beginning[board] = self._work.spawn(self._forget_services(board, beginners))
        self._bus.serve(keys.neighbour_mail(self._bus.fleet, self._bus.name), Mailboxes, self._list_mail)
        for host in list(self.hosts.values()):
            self._begin(host)
        for board in boards:
            agents = partial(self._agents_of, board)
            self._work.spawn(
                report_health(self._bus, board, self._clock, lambda: Health(drops=stdout().dropped), agents)
            )
        self._unit.ready(f"reasoning: {', '.join(self.hosts)}")
        watch = asyncio.create_task(stop.wait())
        watch.add_done_callback(lambda _: self._end_all())
        beats = self._unit.loop()  # one for all agents: a mind that hangs keeps this loop, too, from turning
        pause = min(TURN, beats.period or TURN)
        try:
            while self._running:
                beats.beat()
                self._ended.clear()
                await wait_at_most(self._ended, in_step(asyncio.get_running_loop().time(), pause))
                for task in [task for task in self._running if task.done()]:
                    del self._running[task]
                    task.result()
                self._report()
        finally:
            beats.end()
            self._unit.stopping()
            watch.cancel()
            self._work.cancel()
            forgotten = [] if self.stopped is None else [name for name in self.hosts if name in self._mission.agents]
            await self._commits.close(forgotten)
            for name in forgotten:
                forget_name(self._state, name)
            self._writer.shutdown(wait=False)

    async def _list_mail(self, query: Query[Mailboxes]) -> None:
        """Reply with the mail between the agents that no mind has taken: its longest queues."""
        queues, board = tuple(self._neighbours.queues()[:QUEUES]), self._homes.get(self._bus.name, "")
        record = Mailboxes(header=self._bus.header("neighbour_mail"), board=board, queues=queues)
        query.reply(record, keys.neighbour_mail(self._bus.fleet, self._bus.name))

    def _agents_of(self, board: str) -> Agents:
        """Return what returns the health of each agent of a board that reasons."""
        return {name: host.health for name, host in self._reasoning.items() if self._homes[name] == board}

    def _report(self) -> None:
        """Report the agents and their warnings to the service manager."""
        notes = [f"{name}: {note.text}" for name, host in self.hosts.items() for note in host.notes()]
        away = [] if self._bus.router_up else ["the router is lost"]
        self._unit.status(f"reasoning: {', '.join(self.hosts)}", *away, *notes)

    def _retry_mail(self, there: bool) -> None:
        """Retry mail immediately when commd or the router is back."""
        if there:
            for host in self.hosts.values():
                host.retry_mail()

    def _end_all(self) -> None:
        self._stop.set()
        for end in self._ends.values():
            end.set()

    def _begin(self, host: AgentHost) -> None:
        end = self._ends[host.part.name] = asyncio.Event()
        if self._stop.is_set():
            end.set()
        task = asyncio.create_task(self._live(host, end))
        self._running[task] = host.part.name
        task.add_done_callback(lambda _: self._ended.set())
        self._presence_beliefs.begin(host.part.name)
        if host.part.presence:
            self._presence_beliefs.subscribe(host.part.name, host.feed)

    async def _forget_services(self, board: str, names: Sequence[str]) -> None:
        """Remove the services and subscriptions of former lives of agents."""
        try:
            self.directory.update(await self._services.ask(board, names[0], "leave", others=names[1:]))
        except NotDone as why:
            who = ",".join(names)
            log.warning("agents=%s may still be listed with the services of a former life: %s", who, why)

    async def _live(self, host: AgentHost, end: asyncio.Event) -> None:
        """Run one agent. If its program stops the team, all agents of this daemon end."""
        name = host.part.name
        self._reasoning[name] = host
        try:
            await host.run(end)
        finally:
            del self._reasoning[name]
        if host.stopped is not None:
            log.info("agent=%s stops the team", name)
            self.stopped = self.stopped or host.stopped
            self._end_all()
        self._presence_beliefs.end(name)
        if name in self._made:
            await self._gone(host)

    async def _gone(self, host: AgentHost) -> None:
        """Remove an agent created at run time that has ended; its name is free when its board has removed it too."""
        name = host.part.name
        host.close()
        self.directory.remove(name)
        try:
            async with asyncio.timeout(LEAVING if self._stop.is_set() else None):
                await self._ask(name, "leave")
        except (NotDone, TimeoutError) as why:
            log.warning("agent=%s its board forgets it later: %s", name, why or "its commd does not answer")
        self._services.done_with(name)
        self._by_hand.remove(name)
        del self._made[name], self.hosts[name], self._ends[name], self._homes[name]

    # --- requests ---

    async def answer(self, host: AgentHost, request: TeamRequest) -> TeamReply:
        """Fulfil a request. The reply has the error if that fails."""
        try:
            handler = getattr(self, f"_do_{request.what}", None)
            if handler is None:
                raise TeamRequestRefused("action_failed", f"agentd serve does not do what '{request.what}' asks for")
            value = await handler(host, *request.arguments)
            if isinstance(value, Included):
                value = host.included(request.id, value)
            return TeamReply(request.id, value)
        except TeamRequestRefused as refused:
            return TeamReply(request.id, None, refused.error, str(refused))
        except (NotAllowed, SyntaxErrors, DirectiveError, AlreadyRunning, BusClosed) as error:
            return TeamReply(request.id, None, "unknown", str(error))
        except (OSError, UnicodeDecodeError) as error:
            return TeamReply(request.id, None, "unknown", getattr(error, "strerror", None) or str(error))

    def _files(self, host: AgentHost) -> AgentFiles:
        return AgentFiles([self._mission.path.parent], self._state / host.part.name)

    async def _do_create(self, host: AgentHost, name: str, path: str) -> str:
        program, sources = CompiledProgram(host.part.program.file), Sources()
        if path:
            found = self._files(host).readable(path, host.part.program.file)
            sources = Sources(main=str(found))
            read = sources.parse_file
            program = await asyncio.to_thread(lambda: compile_program(read(found), read))
        made = await self._make(host, name, program, sources)
        self._begin(made)
        log.info("agent=%s made=%s program=%s", host.part.name, made.part.name, path or "none")
        return made.part.name

    async def _do_clone(self, host: AgentHost, name: str) -> str:
        made = await self._make(host, name, CompiledProgram(host.part.program.file), Sources())
        made.copy_from(host)
        self._begin(made)
        log.info("agent=%s cloned=%s", host.part.name, made.part.name)
        return made.part.name

    async def _make(self, maker: AgentHost, wanted: str, program: CompiledProgram, sources: Sources) -> AgentHost:
        """Find a free name, let it join the board of its creator and claim it on the bus."""
        try:
            check_name(wanted)
        except ValueError as error:
            raise TeamRequestRefused("unknown", str(error)) from None
        taken = {*self._mission.robots, *self._mission.boards, *RESERVED}
        for number in range(MOST_TRIES):
            if len(self._made) >= MOST_MADE:
                raise TeamRequestRefused("unknown", f"this daemon takes at most {MOST_MADE} agents made at run time")
            name = wanted if number == 0 else f"{wanted}_{number}"
            if name in self.directory.names or name in taken or name in self._made:
                continue
            self._made[name] = None  # before the first await: reserves the name and the place
            try:
                if made := await self._welcome(name, program, sources, self._homes[maker.part.name]):
                    return made
            except BaseException:
                del self._made[name]
                raise
            del self._made[name]
        raise TeamRequestRefused("unknown", f"{MOST_TRIES} agents are called {wanted} or {wanted}_N already")

    async def _welcome(self, name: str, program: CompiledProgram, sources: Sources, board: str) -> AgentHost | None:
        """Let a new agent join a board; None if its name is taken somewhere. Raises NotDone, BusClosed."""
        try:
            self.directory.update(await self._services.ask(board, name, "join"))
            part = Part(name, program, seed=self._seed, inject=self._mission.inject, sources=sources)
            return self._house(part, board, await self._bus.claim(name))
        except AlreadyRunning:
            return None
        except NotDone as why:
            if why.answered and name.startswith(why.prefix):
                return None
            raise

    async def _do_kill(self, host: AgentHost, name: str, delay: float) -> Any:
        if name not in self.directory.names:
            raise TeamRequestRefused("ia_failed", f"there is no agent '{name}'")
        if name in self._mission.agents:
            message = (
                f"'{name}' is an agent of the mission: only those made at run time can be killed; .stopMAS ends all"
            )
            raise TeamRequestRefused("action_failed", message)
        if name not in self._ends:
            why = "is still being made" if name in self._made else "lives in another daemon, which alone can end it"
            raise TeamRequestRefused("action_failed", f"'{name}' {why}")
        end = self._ends[name]
        if delay > 0:
            asyncio.get_running_loop().call_later(self._clock.to_wall(delay), end.set)
            return EMPTY
        end.set()
        self.directory.remove(name)
        log.info("agent=%s killed=%s", host.part.name, name)
        if name != host.part.name:
            lives = [task for task, agent in self._running.items() if agent == name]
            await asyncio.wait(lives, timeout=ENDING)
        return EMPTY

    async def _do_include(self, host: AgentHost, path: str, namespace: str) -> Included | None:
        try:
            found = self._files(host).readable(path, host.part.program.file)
        except FileNotFoundError as error:
            log.error("agent=%s cannot include: %s", host.part.name, error)
            return None
        sources = Sources(main=str(found))
        read = sources.parse_file
        program = await asyncio.to_thread(lambda: compile_program(read(found), read, namespace=namespace))
        return Included(program, str(found), namespace, sources)

    async def _do_save(self, host: AgentHost, path: str, text: str) -> Any:
        await asyncio.to_thread(self._files(host).save, path, text)
        return EMPTY

    # --- the directory of services ---

    async def _ask(self, agent: str, do: Do, service: str = "") -> BoardServices:
        """Ask the directory of an agent's board. Raises NotDone."""
        if (beginning := self._beginning.get(self._homes[agent])) is not None:
            await asyncio.wait((beginning,))  # what an agent offers now must not be forgotten with its former life
        answer = await self._services.ask(self._homes[agent], agent, do, service)
        self.directory.update(answer)
        return answer

    async def _df(self, do: Do, host: AgentHost, service: str) -> Any:
        """Carry out a request; the board sends the providers that an agent subscribes to by mail from `df`."""
        answer = await self._ask(host.part.name, do, service)
        return make_list([atom(name) for name in answer.found])

    _do_df_register = partialmethod(_df, "register")
    _do_df_deregister = partialmethod(_df, "deregister")
    _do_df_search = partialmethod(_df, "search")
    _do_df_subscribe = partialmethod(_df, "subscribe")
