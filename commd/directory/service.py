"""The directory of a board: serves `{board}/services`, follows the other boards' records, and keeps both on disk.

A known name stays known while its board is away. An agent that joined at run time is forgotten when it leaves, or,
unless it stays, when it was absent for `FORGOTTEN_AFTER` while this board was up.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from sqlite3 import Connection
from typing import Any, TypeVar

import msgspec

from commd.bus.bus import Bus, Query
from commd.bus.errors import BusError, CannotServe
from commd.common.clock import Clock
from commd.common.tasks import Tasks
from commd.directory.registry import Notice, Own, Problem, Services
from commd.liveness.presence import Tokens
from commd.mail import queries
from commd.mail.age_clock import RollbackWitness
from commd.mail.message import named
from commd.mail.service import MailService
from commd.mail.store import StoreFailed
from schemas.liveness import FORGOTTEN_AFTER
from schemas.mission.access_rules import checked, made_on
from schemas.mission.model import THIS_MACHINE, Mission
from schemas.wire import keys
from schemas.wire.codec import BadRecord, codec
from schemas.wire.records import BoardServices, Health, Message, Note, ServiceRequest
from schemas.wire.terms import Structure

ASK_EVERY = 30.0
"""Wall seconds between two queries of the other boards: a published change may have been lost."""
ASK_TIMEOUT = 5.0
ASK_AGAIN = 0.1
"""Wall seconds until a board that did not answer is asked again, doubled each time."""
LOOK_EVERY = 1.0
AROUND_EVERY = 1.0
"""Wall seconds between two queries of all boards for an unknown name, and the timeout of one."""
PUT_EVERY = 0.1
"""Least wall seconds between two puts."""
READ_AGAIN = 0.5
"""Wall seconds until an unreadable file is read again, doubled up to `READ_EVERY`."""
READ_EVERY = 5.0
MAX_RECORD_BYTES = 1024 * 1024
"""Bytes of a board's record: other boards refuse a much larger one."""
MOST_TASKS = 1_000
"""Records of other boards that may wait for the disk; further ones are dropped, counted and asked for again."""
SENDER = "df"
T = TypeVar("T")
log = logging.getLogger("directory")


class Directory:
    """The directory of one board. Make it with `open_directory`."""

    def __init__(
        self, bus: Bus, board: str, mission: Mission, mail_service: MailService, clock: Clock, secured: bool = False
    ) -> None:
        """`secured`: routers control who queries which key, so the key alone identifies the asker."""
        boards = tuple(mission.boards) or (THIS_MACHINE,)
        reserved = frozenset((*mission.robots, *boards))
        prefix = made_on(board) if secured else ""
        self.services = Services(board, mission.mailboxes, boards, reserved, prefix)
        self.counters: Counter[str] = Counter()
        """`notices`, `notices_refused`, `board_changes`, `left`: agents that were forgotten."""
        self._bus, self._board, self._clock, self._secured = bus, board, clock, secured
        self._mail_service, self._store = mail_service, mail_service.store
        self._witness = RollbackWitness(board, bus.boot, mail_service.clock)
        self._one_at_a_time = asyncio.Lock()
        self._alive = Tokens()
        """Tokens of the agents that joined here."""
        self._absent: dict[str, float] = {}
        """Absent agents that joined here: since when, on the process clock."""
        self._boards = Tokens()
        """Boots of the commd of each board, this one too."""
        self._put_at = -PUT_EVERY
        self._putting: asyncio.TimerHandle | None = None
        self._around: asyncio.Task[None] | None = None
        self._around_at = -AROUND_EVERY
        self._tasks = Tasks("directory of services")
        self._reported_doubles: set[str] = set()
        self._unread = ""
        """Why the directory on disk is not read yet, for people."""
        self._noticed = 0

    async def ask_around(self) -> None:
        """Query the other boards: an agent may know a new name before this board does."""
        if self._around is None or (self._around.done() and self._clock.wall() >= self._around_at + AROUND_EVERY):
            boards = [board for board in self._boards if board != self._board]
            self._around, self._around_at = self._tasks.spawn(self._ask_all(boards)), self._clock.wall()
        await asyncio.wait((self._around,), timeout=AROUND_EVERY)

    async def _ask_all(self, boards: Sequence[str]) -> None:
        await asyncio.gather(*map(self._asked, boards))

    def notes(self) -> tuple[Note, ...]:
        """Return the present warnings."""
        notes = [Note("directory_unread", self._unread)] if self._unread else []
        if len(self._boards.get(self._board, ())) > 1:
            notes.append(Note("board_twice", f"another commd serves board `{self._board}` as well"))
        notes += self.services.doubled()
        return (*notes, self._witness.note) if self._witness.note is not None else tuple(notes)

    def health(self) -> Health:
        """Return counters and warnings for the daemon's health."""
        counters = {f"directory_{name}": float(count) for name, count in sorted(self.counters.items())}
        counters["boards_there"] = float(len(self._boards))
        counters["names_known"] = float(len(self._mail_service.homes))
        return Health(counters=counters, notes=self.notes())

    async def load(self) -> bool:
        """Read the directory from disk, serve the mail of those that joined before, and become the directory of the
        mail.

        Returns False if the disk fails. It does not start empty then: the next change would overwrite it.
        """
        try:
            own, others = await self._store.read(lambda db: (queries.kept(db, _OWN), queries.kept(db, _BOARDS)))
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
                name: self._checked(_BOARD.decode(record)) for name, record in others.items() if name in services.boards
            }
        except (msgspec.DecodeError, BadRecord) as bad:  # of another version: it is asked for again
            log.error("directory_unreadable why=%s: it starts empty", bad)
            known = {}
        self._now_is(replace(services, others=known))
        self._mail_service.ask_around = self.ask_around
        for name in self.services.own.joined:
            self._mail_service.host(name)
            self._absent[name] = self._clock.wall()
        return True

    async def run(self) -> None:
        """Read the directory if that has failed, then serve it, follow the others, and forget who is gone, for ever."""
        pause = READ_AGAIN
        while self._unread:
            await asyncio.sleep(pause)
            pause = min(2 * pause, READ_EVERY)
            await self.load()
        await asyncio.gather(self._follow(), self._forget_who_is_gone())

    async def _follow(self) -> None:
        """Serve, and watch the agents and the other boards, for ever."""
        fleet = self._bus.fleet
        self._bus.serve(keys.services(fleet, self._board), ServiceRequest, self._answer)
        self._bus.serve(keys.service_requests(fleet, self._board, "*"), ServiceRequest, self._answer)
        self._bus.subscribe(keys.services(fleet, "*"), BoardServices, self._received)
        for daemon in ("agentd", "client"):
            self._bus.watch(keys.alive(fleet, "*", daemon, "*"), self._agent_token)
        self._bus.watch(keys.alive(fleet, "*", "commd", "*"), self._board_token)
        self._put()
        while True:
            await asyncio.sleep(ASK_EVERY)
            for board in list(self._boards):
                self._ask_soon(board)

    async def _forget_who_is_gone(self) -> None:
        """Remove agents that joined here and were absent for `FORGOTTEN_AFTER`, for ever."""
        while True:
            await asyncio.sleep(LOOK_EVERY)
            now = self._clock.wall()
            for name in [name for name, since in self._absent.items() if now - since >= FORGOTTEN_AFTER]:
                if name in self.services.own.staying:
                    continue
                try:
                    await self._fulfil(ServiceRequest(agent=name, do="leave"))
                except StoreFailed:
                    continue  # retried at the next check
                self.counters["left"] += 1
                log.warning("agent=%s was absent for %g s: it is forgotten", name, FORGOTTEN_AFTER)

    async def _answer(self, query: Query[ServiceRequest]) -> None:
        if query.error or (query.record is not None and not query.concrete):
            raise CannotServe(query.error or "expected a concrete key: a request is for one board")
        if query.record is None:
            key = keys.services(self._bus.fleet, self._board)
            query.reply(self._record(), key)
            for record in self.services.others.values() if query.concrete else ():
                query.reply(record, key)
            return
        asks = query.key.removeprefix(keys.services(self._bus.fleet, self._board)).removeprefix("/")
        if asks != query.record.agent and (asks or self._secured):
            own = keys.service_requests(self._bus.fleet, self._board, query.record.agent)
            raise CannotServe(f"a request of `{query.record.agent}` is accepted on {own} only")
        try:
            query.reply(await self._fulfil(query.record))
        except Problem as problem:
            query.reply(self._record(problem=str(problem)))
        except StoreFailed as failed:
            query.reply(self._record(problem=f"commd of board {self._board} cannot keep it: {failed}"))

    async def _fulfil(self, request: ServiceRequest) -> BoardServices:
        """Fulfil an agent's request. Raises Problem, and StoreFailed if it could not be written."""
        async with self._one_at_a_time:
            before, agent, service = self.services, request.agent, request.service
            after, notices = before, list[Notice]()
            match request.do:
                case "join":
                    after = before.join(agent, request.stays)
                case "leave":
                    after = before.leave(agent, *request.others)
                case "register":
                    after, notices = before.register(agent, service)
                case "deregister":
                    after = before.deregister(agent, service)
                case "subscribe":
                    after, notices = before.subscribe(agent, service)
            if request.do in ("join", "register") and after is not before:
                size = len(_BOARD.encode(BoardServices(board=self._board, agents=after.agents())))
                if size > MAX_RECORD_BYTES:
                    what = f"{request.do} {agent}: the record of board {self._board} would have {size} bytes"
                    raise Problem(f"{what}, the limit is {MAX_RECORD_BYTES}")
            if after is not before or notices:
                own = msgspec.json.encode(after.own)
                await self._write(notices, lambda db: queries.keep(db, _OWN, self._board, own))
                self._now_is(after)
            for name in set(after.own.joined) - set(before.own.joined):
                self._mail_service.host(name)
                if name not in self._alive:
                    self._absent[name] = self._clock.wall()
            if after.own.version != before.own.version:
                self._put()
            for name in set(before.own.joined) - set(after.own.joined):
                self._absent.pop(name, None)
                with suppress(StoreFailed):  # the mail service gives up its mail later
                    await self._mail_service.unhost(name)
            found = after.providers(service) if request.do in ("search", "subscribe") else ()
            return self._record(found=found)

    async def _write(self, notices: list[Notice], change: Callable[[Connection], None]) -> None:
        """Write a change together with its notices. Raises StoreFailed: then neither is written."""
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
        content = Structure("provider", (named(agent), service))
        number = f"df.{self._bus.boot}.{self._noticed}"
        return Message(id=number, sender=SENDER, performative="tell", receiver=subscriber, content=content)

    def _record(self, *, found: tuple[str, ...] = (), problem: str = "") -> BoardServices:
        """Return this board's record."""
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
        """Publish this board's record, now or `PUT_EVERY` after the last time."""
        pause = self._put_at + PUT_EVERY - self._clock.wall()
        if pause <= 0:
            self._putting, self._put_at = None, self._clock.wall()
            self._bus.put(keys.services(self._bus.fleet, self._board), self._record())
        elif self._putting is None:
            self._putting = asyncio.get_running_loop().call_later(pause, self._put_late)

    def _put_late(self) -> None:
        self._putting, self._put_at = None, -PUT_EVERY
        self._put()

    def _now_is(self, services: Services) -> None:
        self.services = services
        self._mail_service.know_everybody(services.homes())
        for double in services.doubled():
            if double.text not in self._reported_doubles:
                self._reported_doubles.add(double.text)
                log.error("%s", double.text)

    def _received(self, key: str, record: BoardServices) -> None:
        parsed = keys.parse(key)
        if parsed is not None and parsed[1] == record.board and self._concerns_us(record):
            self._spawn(self._hear(record))

    def _concerns_us(self, record: BoardServices) -> bool:
        return record.board in self.services.boards and record.board != self._board

    def _checked(self, record: BoardServices) -> BoardServices:
        """Return the valid part of a board's record; where access is controlled, without names of other boards."""
        found = checked(record, self.services.mission, self._secured)
        if found is not record:
            taken = len(found.agents), len(record.agents)
            log.warning("board=%s its record is accepted in part: %d of %d agents", record.board, *taken)
        return found

    async def _hear(self, record: BoardServices) -> None:
        """Apply another board's record, after it was written to disk."""
        async with self._one_at_a_time:
            await self._compare_mail(record)
            if not self.services.news(record):
                return
            record = self._checked(record)
            before = self.services.others.get(record.board)
            after, notices, gone = self.services.heard(record)
            kept = _BOARD.encode(record)
            try:
                await self._write(notices, lambda db: queries.keep(db, _BOARDS, record.board, kept))
            except StoreFailed as failed:
                log.error("board=%s its record is not stored, it is asked for again: %s", record.board, failed)
                return
            self.counters["board_changes"] += 1
            self._now_is(after)
            if before is None or before.agents != record.agents:
                log.info("board=%s agents=%d", record.board, len(record.agents))
            for name in gone:
                with suppress(StoreFailed):  # the mail service gives up its mail later
                    await self._mail_service.gone(name)

    async def _compare_mail(self, record: BoardServices) -> None:
        """Compare our mail file with what another board has seen of it, and remember theirs."""
        self._witness.judge(record)
        if (seen := self._witness.news(record)) is not None:
            with suppress(StoreFailed):  # it comes again
                await self._store.write(lambda db: self._witness.keep(db, record.board, seen))
                self._witness.seen = {**self._witness.seen, record.board: seen}

    def _board_token(self, key: str, alive: bool) -> None:
        if (parsed := keys.parse_alive(key)) is None or parsed[1] not in self.services.boards:
            return
        _, board, _, boot = parsed
        known = boot in self._boards.get(board, ())
        self._boards.note(board, boot, alive)
        if alive and not known:
            self._ask_soon(board)
            if board == self._board and len(self._boards[board]) > 1:
                log.error(
                    "another commd serves board `%s` as well: its mail goes now to one and now to the other", board
                )

    def _ask_soon(self, board: str) -> None:
        if board != self._board:
            self._spawn(self._ask(board))

    async def _ask(self, board: str) -> None:
        """Query a board for its record: its token may arrive before its queryable."""
        pause = ASK_AGAIN
        while not await self._asked(board) and board in self._boards and pause < ASK_EVERY:
            await asyncio.sleep(pause)
            pause *= 2

    async def _asked(self, board: str) -> bool:
        """Query once. Returns whether it answered."""
        try:  # its own record comes first, then those that it has of others
            record = await self._bus.ask_one(keys.services(self._bus.fleet, board), None, BoardServices, ASK_TIMEOUT)
        except BusError as error:
            log.debug("not_asked board=%s why=%s", board, error)
            return False
        if record.board == board:
            await self._hear(record)
        return record.board == board

    def _agent_token(self, key: str, alive: bool) -> None:
        """Note that an agent appeared or ended; only those that joined here count."""
        if (parsed := keys.parse(key)) is None:
            return
        name = parsed[1]
        ended = self._alive.note(name, key, alive)
        if alive:
            self._absent.pop(name, None)
        elif ended and name in self.services.own.joined:
            self._absent[name] = self._clock.wall()

    def _spawn(self, work: Coroutine[Any, Any, None]) -> None:
        if len(self._tasks) >= MOST_TASKS:
            work.close()
            self.counters["dropped"] += 1
            return
        self._tasks.spawn(work)

    async def close(self) -> None:
        """End all tasks."""
        if self._putting is not None:
            self._putting.cancel()
        await self._tasks.end()


@asynccontextmanager
async def open_directory(
    bus: Bus, board: str, mission: Mission, mail_service: MailService, clock: Clock, secured: bool = False
) -> AsyncIterator[Directory]:
    """Read the directory of a board; the caller must `run` it, which keeps it up to date, until the end."""
    directory = Directory(bus, board, mission, mail_service, clock, secured)
    if not await directory.load():  # a file that was just set aside as corrupt is a new one at the second attempt
        await asyncio.sleep(READ_AGAIN)
        await directory.load()
    try:
        yield directory
    finally:
        await directory.close()


_OWN, _BOARDS = "services", "board"
"""Kinds of facts: this board's own agents, and the last records of others."""
_BOARD = codec(BoardServices)
