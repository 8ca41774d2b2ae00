"""Mail for a program that is no agent: each message is acknowledged when the program is done with it.

Until then `commd` keeps it on disk and offers it again. What was done is told from what is new by the numbers of each
sender; they are remembered for this life, and in a file for the next ones if there is one.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections import OrderedDict, deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from commd.bus.bus import Bus, Query
from commd.process.state_dir import make_private_file
from schemas.wire import keys
from schemas.wire.records import Mail, Message, Receipt, Refusal

log = logging.getLogger("inbox")

ANSWER_WITHIN = 2.0
"""Wall seconds after which `commd` is told how far the program has come; what it is not done with is offered again."""
ASKING = 0.05
"""The same while it waits for an answer: that may stand behind what `commd` is told of."""
ROOM = 10_000
"""Messages that wait here for the program at most; the others wait at `commd`."""
NUMBERINGS = 1_000
"""Numberings (lives) of a sender that are told apart: more than the 500 that a batch of commd's can bring."""
QUESTION = "sync:"
"""What the ids of a program's questions begin with: an agent answers `false` to who waits (`sync`); no name has `:`."""
LEAVE = 1.0
"""Wall seconds for the last answers."""

NOT_DONE: Final = Refusal(code="not_absorbed", text="the program is not done with it")


class Seen:
    """The number of the last message that was done with, per sender and numbering; kept in `file` if there is one."""

    def __init__(self, file: Path | None) -> None:
        self._file = file
        self._last: dict[str, OrderedDict[str, int]] = {}
        if file is not None and file.exists():
            self._load(file)

    def has(self, message: Message) -> bool:
        """Whether the program is done with a message."""
        lives = self._last.get(message.sender)
        return lives is not None and message.header.seq <= lives.get(message.header.boot, 0)

    def note(self, message: Message) -> None:
        """The program is done with a message. Raises OSError if that cannot be written down."""
        lives = self._last.setdefault(message.sender, OrderedDict())
        lives[message.header.boot] = max(message.header.seq, lives.get(message.header.boot, 0))
        lives.move_to_end(message.header.boot)
        while len(lives) > NUMBERINGS:
            lives.popitem(last=False)
        if self._file is not None:
            fresh = self._file.with_name(self._file.name + ".new")
            make_private_file(fresh)
            fresh.write_text(json.dumps(self._last))
            os.replace(fresh, self._file)

    def _load(self, file: Path) -> None:
        try:
            for sender, lives in json.loads(file.read_text()).items():
                self._last[sender] = OrderedDict((str(life), int(number)) for life, number in lives.items())
        except (ValueError, AttributeError, TypeError) as error:
            aside = file.with_name(file.name + ".corrupt")
            os.replace(file, aside)
            self._last.clear()
            log.warning("numbers_unreadable set aside as %s: messages may come twice: %s", aside, error)


class Inbox:
    """The incoming mail of one name."""

    def __init__(self, bus: Bus, name: str, seen: Seen) -> None:
        self._name, self._seen = name, seen
        self._waiting: deque[tuple[Message, float]] = deque()
        """What the program is not done with, and when it expires; the first one may be in its hands."""
        self._known: set[tuple[str, str, int]] = set()
        """Whose numbers wait."""
        self._late: OrderedDict[tuple[str, str, int], None] = OrderedDict()
        """The last ones whose time was over before the program came to them."""
        self._asked: dict[str, asyncio.Future[Message]] = {}
        """The questions whose answers are waited for."""
        self._held: set[asyncio.Timeout] = set()
        """Until when `commd` is told at the latest, of each batch."""
        self._changed = asyncio.Event()
        """Set and replaced whenever something came or is done."""
        self._answering = 0
        self._leaving = False
        self._reader: Messages | None = None
        self._close = bus.serve(keys.inbox(bus.fleet, name), Mail, self._receive)

    def read(self) -> Messages:
        """Begin to read: the messages that are not done with, and then those that come."""
        self._reader = Messages(self)
        return self._reader

    def done(self, message: Message) -> None:
        """The program is done with the message that it has in hand."""
        if self._waiting and self._waiting[0][0] is message:
            self._seen.note(message)
            self._drop_first()
            self._pass_answers()
            self._notify()

    @contextmanager
    def answer_to(self, question: str) -> Iterator[asyncio.Future[Message]]:
        """Wait for the answer to a question while the block runs."""
        loop = asyncio.get_running_loop()
        self._asked[question] = answer = loop.create_future()
        for held in self._held:
            if not held.expired():
                held.reschedule(min(held.when() or 0, loop.time() + ASKING))
        try:
            yield answer
        finally:
            del self._asked[question]

    @property
    def undone(self) -> int:
        """Messages that have come and that the program is not done with."""
        return len(self._waiting)

    async def first(self, reader: Messages) -> Message:
        """Wait for the first message that is not done with; it stays the first until it is."""
        while True:
            if reader is not self._reader:
                raise RuntimeError("another loop reads the messages of this client by now")
            while self._waiting and self._waiting[0][1] < asyncio.get_running_loop().time():
                self._late[_number(self._waiting[0][0])] = None  # commd is told, and tells its sender
                if len(self._late) > ROOM:
                    self._late.popitem(last=False)
                self._drop_first()
            self._pass_answers()
            if self._waiting:
                return self._waiting[0][0]
            await self._changed.wait()

    async def close(self) -> None:
        """Take no mail any more; answer how far the program has come."""
        self._close()
        self._leaving = True
        self._notify()
        with suppress(TimeoutError):
            async with asyncio.timeout(LEAVE):
                while self._answering:
                    await self._changed.wait()

    def _pass_answers(self) -> None:
        """Be done with answers, which no loop is handed, also with those that nobody waits for any more.

        A number says of all below it that they are done: an answer stays while a message before it of its sender does.
        """
        if not any(_is_answer(message) for message, _ in self._waiting):
            return
        left, held = deque[tuple[Message, float]](), set[tuple[str, str]]()
        for message, until in self._waiting:
            life = (message.sender, message.header.boot)
            if _is_answer(message) and life not in held:
                self._seen.note(message)
                self._known.discard(_number(message))
            else:
                left.append((message, until))
                held.add(life)
        self._waiting = left

    def _drop_first(self) -> None:
        self._known.discard(_number(self._waiting.popleft()[0]))

    def _notify(self) -> None:
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    async def _receive(self, query: Query[Mail]) -> None:
        if query.record is None or not query.concrete:
            query.reply_error(query.error or "expected a Mail record on a concrete key")
            return
        self._answering += 1
        try:
            batch, refused = query.record.messages, dict[int, Refusal]()
            held: set[tuple[str, str]] = set()
            """Of whom a message is refused as too late: were a later one done, it would pass for done when it comes
            again because this answer was lost."""
            for place, message in enumerate(batch):
                if not message.header.seq or message.receiver != self._name:
                    expected = f"expected a numbered message to {self._name}, as commd hands it over"
                    refused[place] = Refusal(code="wrong_address", text=expected)
                elif self._too_late(message):
                    refused[place] = Refusal(code="expired")
                    held.add((message.sender, message.header.boot))
                elif (message.sender, message.header.boot) not in held:
                    self._queue(message)
            self._pass_answers()
            self._notify()
            with suppress(TimeoutError):
                async with asyncio.timeout(ASKING if self._asked else ANSWER_WITHIN) as held_until:
                    self._held.add(held_until)
                    try:
                        while not self._leaving and self._not_done(batch, refused):
                            await self._changed.wait()
                    finally:
                        self._held.discard(held_until)
            later = dict.fromkeys(self._not_done(batch, refused), NOT_DONE)
            query.reply(Receipt(taken=len(batch) - len(refused) - len(later), refused=refused, later=later))
        finally:
            self._answering -= 1
            self._notify()

    def _queue(self, message: Message) -> None:
        number, answer = _number(message), self._asked.get(message.in_reply_to)
        if answer is not None and not answer.done():
            answer.set_result(message)
        if len(self._waiting) < ROOM and number not in self._known and not self._seen.has(message):
            until = float("inf") if message.ttl is None else asyncio.get_running_loop().time() + message.ttl
            self._known.add(number)
            self._waiting.append((message, until))

    def _too_late(self, message: Message) -> bool:
        """Whether the program will not come to a message any more, as its time was over before."""
        number = _number(message)
        if number in self._late:
            return True
        over = message.ttl is not None and message.ttl <= 0
        return over and number not in self._known and not self._seen.has(message)

    def _not_done(self, batch: tuple[Message, ...], refused: dict[int, Refusal]) -> list[int]:
        """The places in a batch of what the program is not done with."""
        return [
            place
            for place, one in enumerate(batch)
            if place not in refused and (not self._seen.has(one) or _number(one) in self._late)
        ]


class Messages:
    """What `async for` goes through: to ask for the next message is to be done with the one before."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self._in_hand: Message | None = None

    def __aiter__(self) -> Messages:
        return self

    async def __anext__(self) -> Message:
        if self._in_hand is not None:
            self._inbox.done(self._in_hand)
            self._in_hand = None
        self._in_hand = await self._inbox.first(self)
        return self._in_hand


def _is_answer(message: Message) -> bool:
    """Whether a message answers a question of `ask`, in this life of the program or in one before."""
    return message.in_reply_to.startswith(QUESTION)


def _number(message: Message) -> tuple[str, str, int]:
    return (message.sender, message.header.boot, message.header.seq)
