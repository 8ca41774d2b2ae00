"""The directory of a board: serves `{board}/services`, follows what the other boards say, and keeps both on disk.

A name that was known once stays known while its board is away. An agent that joined at run time is forgotten when it
leaves, or, unless it said that it stays, when it has been gone for `FORGOTTEN_AFTER` while this board was up.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator, Callable, Collection, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from sqlite3 import Connection
from typing import Any, TypeVar

import msgspec

from commd.bus.bus import Bus, Query
from commd.bus.errors import BusClosed
from commd.common.clock import Clock
from commd.common.tasks import Tasks
from commd.directory.registry import Notice, Own, Problem, Services, checked
from commd.mail import schema
from commd.mail.age_clock import RollbackWitness
from commd.mail.service import MailService
from commd.mail.store import StoreFailed
from schemas.liveness import FORGOTTEN_AFTER
from schemas.mission.access_rules import made_on
from schemas.mission.model import THIS_MACHINE, Mission
from schemas.wire import keys
from schemas.wire.codec import BadRecord, codec
from schemas.wire.records import BoardServices, Health, Message, Note, ServiceRequest
from schemas.wire.terms import Atom, Structure, Term

ASK_EVERY = 30.0
"""Wall seconds between two looks at what the other boards know: a change that was put may have been lost."""
ASK_TIMEOUT = 5.0
ASK_AGAIN = 0.1
"""Wall seconds until a board that did not answer is asked again, doubling."""
LOOK_EVERY = 1.0
AROUND_EVERY = 1.0
"""Wall seconds between two times that all boards are asked for somebody whom nobody here knows, and what it takes at
most."""
PUT_EVERY = 0.1
"""Wall seconds between two puts at least."""
READ_AGAIN = 0.5
"""Wall seconds until the file is read again when it could not be read, doubling up to `READ_EVERY`."""
READ_EVERY = 5.0
MOST_SAID = 1024 * 1024
"""Bytes of what a board says of itself: other boards refuse what is much larger, and would know nothing of it."""
MOST_TASKS = 1_000
"""What other boards say may wait so often for the disk; the excess is dropped, counted and asked for again."""
SENDER = "df"
T = TypeVar("T")
log = logging.getLogger("directory")


class Directory:
    """What a board knows of the agents of its fleet. Make it with `open_directory`."""

    def __init__(
        self, bus: Bus, board: str, mission: Mission, mail_service: MailService, clock: Clock, secured: bool = False
    ) -> None:
        """`secured`: routers control who asks on which key, so that only that says for whom a request is."""
        boards = tuple(mission.boards) or (THIS_MACHINE,)
        reserved = frozenset((*mission.robots, *boards))
        prefix = made_on(board) if secured else ""
        self.services = Services(board, mission.mailboxes, boards, reserved, prefix)
        self.counters: Counter[str] = Counter()
        """`notices` and `notices_refused`, `board_changes`, `left`: agents that were gone for good."""
        self._bus, self._board, self._store, self._mail_service, self._clock = (
            bus,
            board,
            mail_service.store,
            mail_service,
            clock,
        )
        self._secured = secured
        self._witness = RollbackWitness(board, bus.boot, mail_service.clock)
        self._homes = self.services.homes()
        self._one_at_a_time = asyncio.Lock()
        self._alive: dict[str, set[str]] = {}
        """The tokens of the agents that joined here."""
        self._absent: dict[str, float] = {}
        """Those that joined here and are not there: since when."""
        self._boards: dict[str, set[str]] = {}
        """The tokens of the commd of each board, this one too."""
        self._put_at = -PUT_EVERY
        self._putting: asyncio.TimerHandle | None = None
        self._around: asyncio.Task[None] | None = None
        self._around_at = -AROUND_EVERY
        self.work: list[asyncio.Task[None]] = []
        """What goes on for ever."""
        self._tasks = Tasks("directory of services")
        self._said_doubles: set[str] = set()
        self._unread = ""
        """Why what is on disk is not known yet, in words."""
        self._noticed = 0

    # --- for the mailroom ---

    def board_of(self, name: str) -> str | None:
        """The board that keeps the mail of an agent, or None for one that nobody knows."""
        return self._homes.get(name)

    def names(self) -> Collection[str]:
        """Everybody who can be sent to, there or away."""
        return self._homes.keys()

    async def ask_around(self) -> None:
        """Hear what the other boards know now: an agent may hear of who joined there before this board does."""
        if self._around is None or (self._around.done() and self._clock.wall() >= self._around_at + AROUND_EVERY):
            boards = [board for board, boots in self._boards.items() if boots and board != self._board]
            self._around, self._around_at = self._tasks.spawn(self._ask_all(boards)), self._clock.wall()
        await asyncio.wait((self._around,), timeout=AROUND_EVERY)

    async def _ask_all(self, boards: Sequence[str]) -> None:
        await asyncio.gather(*map(self._asked, boards))

    def notes(self) -> tuple[Note, ...]:
        """Return what is wrong now."""
        notes = [Note("directory_unread", self._unread)] if self._unread else []
        if len(self._boards.get(self._board, ())) > 1:
            notes.append(Note("board_twice", f"another commd serves board `{self._board}` as well"))
        notes += self.services.doubled()
        return (*notes, self._witness.note) if self._witness.note is not None else tuple(notes)

    def health(self) -> Health:
        """Return what is counted and what is wrong, for the daemon's health."""
        counters = {f"directory_{name}": float(count) for name, count in sorted(self.counters.items())}
        counters["boards_there"] = float(sum(map(bool, self._boards.values())))
        counters["names_known"] = float(len(self._homes))
        return Health(counters=counters, notes=self.notes())

    # --- its life ---

    async def load(self) -> bool:
        """Read what is on disk, host those that joined in a former life, and be the directory of the mail.

        Returns False if it cannot be read now. It never begins empty then: the next change would overwrite it.
        """
        try:
            own, others = await self._store.read(lambda db: (schema.kept(db, _OWN), schema.kept(db, _BOARDS)))
            await self._store.read(self._witness.load)
        except StoreFailed as failed:
            if not self._unread:
                log.error("directory_unread why=%s: nobody can join or leave until it is read", failed)
            self._unread = f"who joined and who offers what is not read yet: {failed}"
            return False
        self._unread = ""
        services = self.services
        try:
            if self._board in own:
                services = replace(services, own=msgspec.json.decode(own[self._board], type=Own))
            known = {
                name: self._checked(_BOARD.decode(said)) for name, said in others.items() if name in services.boards
            }
        except (msgspec.DecodeError, BadRecord) as bad:  # of another version: what is not known is asked for anew
            log.error("directory_unreadable why=%s: it begins empty", bad)
            known = {}
        self._now_is(replace(services, others=known))
        self._mail_service.directory, self._mail_service.ask_around = self, self.ask_around
        for name in self.services.own.joined:
            self._mail_service.host(name)
            self._absent[name] = self._clock.wall()
        return True

    async def read_and_follow(self, read: bool) -> None:
        """Read the file until it can be read, if it is not yet, then `follow`."""
        pause = READ_AGAIN
        while not read:
            await asyncio.sleep(pause)
            read, pause = await self.load(), min(2 * pause, READ_EVERY)
        await self.follow()

    async def follow(self) -> None:
        """Serve, and follow the agents and the other boards, for ever."""
        fleet = self._bus.fleet
        self._bus.serve(keys.services(fleet, self._board), ServiceRequest, self._answer)
        self._bus.serve(keys.service_requests(fleet, self._board, "*"), ServiceRequest, self._answer)
        self._bus.subscribe(keys.services(fleet, "*"), BoardServices, self._told)
        for daemon in ("agentd", "client"):
            self._bus.watch(keys.alive(fleet, "*", daemon, "*"), self._agent_token)
        self._bus.watch(keys.alive(fleet, "*", "commd", "*"), self._board_token)
        self._put()
        while True:
            await asyncio.sleep(ASK_EVERY)
            for board in [board for board, boots in self._boards.items() if boots]:
                self._ask_soon(board)

    async def forget_who_is_gone(self) -> None:
        """Let those leave that joined here and are gone for good, for ever."""
        while True:
            await asyncio.sleep(LOOK_EVERY)
            now = self._clock.wall()
            for name in [name for name, since in self._absent.items() if now - since >= FORGOTTEN_AFTER]:
                if name in self.services.own.staying:
                    continue
                try:
                    await self._fulfil(ServiceRequest(agent=name, do="leave"))
                except StoreFailed:
                    continue  # tried again at the next look
                self.counters["left"] += 1
                log.warning("agent=%s has been gone for %g s: it is forgotten", name, FORGOTTEN_AFTER)

    # --- what agents ask ---

    async def _answer(self, query: Query[ServiceRequest]) -> None:
        if query.error or (query.record is not None and not query.concrete):
            query.reply_error(query.error or "expected a concrete key: a request is for one board")
            return
        if query.record is None:
            key = keys.services(self._bus.fleet, self._board)
            query.reply(self._said(), key)
            for said in self.services.others.values() if query.concrete else ():
                query.reply(said, key)
            return
        asks = query.key.removeprefix(keys.services(self._bus.fleet, self._board)).removeprefix("/")
        if asks != query.record.agent and (asks or self._secured):
            own = keys.service_requests(self._bus.fleet, self._board, query.record.agent)
            query.reply_error(f"a request of `{query.record.agent}` is asked on {own}")
            return
        try:
            query.reply(await self._fulfil(query.record))
        except Problem as problem:
            query.reply(self._said(problem=str(problem)))
        except StoreFailed as failed:
            query.reply(self._said(problem=f"commd of board {self._board} cannot keep it: {failed}"))

    async def _fulfil(self, request: ServiceRequest) -> BoardServices:
        """Do what an agent asks. Raises Problem, and StoreFailed when it could not be written."""
        async with self._one_at_a_time:
            before, agent, service = self.services, request.agent, request.service
            after, notices = before, list[Notice]()
            match request.do:
                case "join":
                    after = before.join(agent, request.stays)
                case "leave":
                    after = before.leave(agent)
                case "register":
                    after, notices = before.register(agent, service)
                case "deregister":
                    after = before.deregister(agent, service)
                case "subscribe":
                    after, notices = before.subscribe(agent, service)
            if request.do in ("join", "register") and after is not before:
                size = len(_BOARD.encode(BoardServices(board=self._board, agents=after.agents())))
                if size > MOST_SAID:
                    what = f"{request.do} {agent}: what board {self._board} says of its agents would be of {size} bytes"
                    raise Problem(f"{what}, and {MOST_SAID} are the most")
            if after is not before or notices:
                own = msgspec.json.encode(after.own)
                await self._write(notices, lambda db: schema.keep(db, _OWN, self._board, own))
                self._now_is(after)
            for name in set(after.own.joined) - set(before.own.joined):
                self._mail_service.host(name)
                if not self._alive.get(name):
                    self._absent[name] = self._clock.wall()
            if after.own.version != before.own.version:
                self._put()
            for name in set(before.own.joined) - set(after.own.joined):
                self._absent.pop(name, None)
                with suppress(StoreFailed):  # it has left: the mailroom gives up later what waits for nobody
                    await self._mail_service.unhost(name)
            found = after.providers(service) if request.do in ("search", "subscribe") else ()
            return self._said(found=found)

    async def _write(self, notices: list[Notice], change: Callable[[Connection], None]) -> None:
        """Write a change together with the notices that it calls for. Raises StoreFailed: then neither is."""
        if not notices:
            await self._store.write(change)
            return
        messages = [self._notice(*notice) for notice in notices]
        receipt = await self._mail_service.take(messages, also=change)
        self.counters["notices"] += receipt.taken
        for place, why in {**receipt.refused, **receipt.later}.items():
            self.counters["notices_refused"] += 1
            log.warning("notice_refused receiver=%s why=%s", messages[place].receiver, why)

    def _notice(self, subscriber: str, agent: str, service: str) -> Message:
        self._noticed += 1
        content = Structure("provider", (named(agent), named(service)))
        number = f"df.{self._bus.boot}.{self._noticed}"
        return Message(id=number, sender=SENDER, performative="tell", receiver=subscriber, content=content)

    def _said(self, *, found: tuple[str, ...] = (), problem: str = "") -> BoardServices:
        """What this board says of itself."""
        header = self._bus.header("services")
        services = self.services
        return BoardServices(
            header=header,
            board=self._board,
            version=services.own.version,
            agents=services.agents(),
            found=found,
            problem=problem,
            prefix=services.prefix,
            mail_time=self._mail_service.clock.saved,
            mail_seen=dict(self._witness.seen),
        )

    def _put(self) -> None:
        """Tell everybody what is known here now, at once or a moment after the last time."""
        pause = self._put_at + PUT_EVERY - self._clock.wall()
        if pause <= 0:
            self._putting, self._put_at = None, self._clock.wall()
            self._bus.put(keys.services(self._bus.fleet, self._board), self._said())
        elif self._putting is None:
            self._putting = asyncio.get_running_loop().call_later(pause, self._put_late)

    def _put_late(self) -> None:
        self._putting, self._put_at = None, -PUT_EVERY
        self._put()

    def _now_is(self, services: Services) -> None:
        self.services, self._homes = services, services.homes()
        for double in services.doubled():
            if double.text not in self._said_doubles:
                self._said_doubles.add(double.text)
                log.error("%s", double.text)

    # --- the other boards ---

    def _told(self, key: str, said: BoardServices) -> None:
        parsed = keys.parse(key)
        if parsed is not None and parsed[1] == said.board and self._concerns_us(said):
            self._spawn(self._hear(said))

    def _concerns_us(self, said: BoardServices) -> bool:
        return said.board in self.services.boards and said.board != self._board

    def _checked(self, said: BoardServices) -> BoardServices:
        """Take what a board may say: where access is controlled, nothing of names that only another may speak for."""
        if not self._secured:
            return checked(said)
        own = made_on(said.board)
        return checked(said, lambda name: name in self.services.mission or name.startswith(own))

    async def _hear(self, said: BoardServices) -> None:
        """Take what another board says of itself, on disk first."""
        async with self._one_at_a_time:
            await self._compare_mail(said)
            if not self.services.news(said):
                return
            said = self._checked(said)
            before = self.services.others.get(said.board)
            after, notices, gone = self.services.heard(said)
            kept = _BOARD.encode(said)
            try:
                await self._write(notices, lambda db: schema.keep(db, _BOARDS, said.board, kept))
            except StoreFailed as failed:
                log.error("board=%s what it says is not kept, it is asked again: %s", said.board, failed)
                return
            self.counters["board_changes"] += 1
            self._now_is(after)
            if before is None or before.agents != said.agents:
                log.info("board=%s agents=%d", said.board, len(said.agents))
            for name in gone:
                with suppress(StoreFailed):  # the mailroom gives up later what waits for nobody
                    await self._mail_service.gone(name)

    async def _compare_mail(self, said: BoardServices) -> None:
        """Judge our mail file by what another board has seen of it, and remember what is seen of theirs."""
        self._witness.judge(said)
        if (seen := self._witness.news(said)) is not None:
            with suppress(StoreFailed):  # it is said again
                await self._store.write(lambda db: self._witness.keep(db, said.board, seen))
                self._witness.seen = {**self._witness.seen, said.board: seen}

    def _board_token(self, key: str, alive: bool) -> None:
        if (parsed := keys.parse(key)) is None or parsed[1] not in self.services.boards:
            return
        board, boots = parsed[1], self._boards.setdefault(parsed[1], set())
        if not alive:
            boots.discard(parsed[2][-1])
        elif parsed[2][-1] not in boots:
            boots.add(parsed[2][-1])
            self._ask_soon(board)
            if board == self._board and len(boots) > 1:
                log.error(
                    "another commd serves board `%s` as well: its mail goes now to one and now to the other", board
                )

    def _ask_soon(self, board: str) -> None:
        if board != self._board:
            self._spawn(self._ask(board))

    async def _ask(self, board: str) -> None:
        """Ask a board for what it knows of itself: its token may be here before what it serves."""
        pause = ASK_AGAIN
        while not await self._asked(board) and self._boards.get(board) and pause < ASK_EVERY:
            await asyncio.sleep(pause)
            pause *= 2

    async def _asked(self, board: str) -> bool:
        """Ask once. Returns whether there was an answer."""
        known: dict[str, BoardServices] = {}
        try:
            key = keys.services(self._bus.fleet, board)
            await self._bus.ask_all(key, BoardServices, ASK_TIMEOUT, lambda _, told: known.update({told.board: told}))
        except BusClosed as closed:
            log.debug("not_asked board=%s why=%s", board, closed)
        if board in known:
            await self._hear(known[board])
        return board in known

    def _agent_token(self, key: str, alive: bool) -> None:
        """An agent came or went; only those count that joined here."""
        if (parsed := keys.parse(key)) is None:
            return
        name, tokens = parsed[1], self._alive.setdefault(parsed[1], set())
        if alive:
            tokens.add(key)
            self._absent.pop(name, None)
            return
        tokens.discard(key)
        if not tokens:
            del self._alive[name]
            if name in self.services.own.joined:
                self._absent[name] = self._clock.wall()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        if len(self._tasks) >= MOST_TASKS:
            work.close()
            self.counters["dropped"] += 1
            return
        self._tasks.spawn(work)

    async def close(self) -> None:
        """End what is under way."""
        if self._putting is not None:
            self._putting.cancel()
        await self._tasks.end()


@asynccontextmanager
async def open_directory(
    bus: Bus, board: str, mission: Mission, mail_service: MailService, clock: Clock, secured: bool = False
) -> AsyncIterator[Directory]:
    """Read the directory of a board, or go on trying while its disk does not let it; keep it up to date until the end.

    Whoever opens it watches `work`: when one of these tasks ends, the board follows nobody any more.
    """
    directory = Directory(bus, board, mission, mail_service, clock, secured)
    read = await directory.load()
    if not read:  # a file that has just been set aside as corrupt is a new one at the second look
        await asyncio.sleep(READ_AGAIN)
        read = await directory.load()
    following, forgetting = directory.read_and_follow(read), directory.forget_who_is_gone()
    work = directory.work = [asyncio.create_task(following), asyncio.create_task(forgetting)]
    try:
        yield directory
    finally:
        for task in work:
            task.cancel()
        await asyncio.gather(*work, return_exceptions=True)
        await directory.close()


def named(name: str) -> Term:
    """A name as an agent's program writes it: an atom where it can be one, else a string."""
    try:
        return msgspec.convert({"kind": "atom", "name": name}, Atom)
    except msgspec.ValidationError:
        return name


_OWN, _BOARDS = "services", "board"
"""Kinds of facts: what this board keeps of its own agents, and what others said last."""
_BOARD = codec(BoardServices)
