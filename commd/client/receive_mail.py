"""Mail of a Python program: each message is acknowledged when the program is done with it.

Until then `commd` keeps it on disk and offers it again. Repeated messages are recognised by the numbers of each sender,
which are kept in memory, and in a file for later processes if there is one.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from commd.bus.bus import Bus, Query
from commd.client.receive_once import EXPIRED, MessageRefused, Numbered, ReceiveOnce, Waiting, is_expired
from commd.process.state_dir import replace_file
from schemas.wire.records import Mail, Message, Refusal

log = logging.getLogger("inbox")

ANSWER_WITHIN = 2.0
"""Wall seconds after which `commd` gets a receipt of the messages that are done with; it offers the others again."""
ASKING = 0.05
"""The same while the program waits for an answer, which may be behind these messages."""
ROOM = 10_000
"""Messages that may wait here for the program; further ones wait at `commd`."""
QUESTION = "sync:"
"""Prefix of the ids of a program's questions: an agent answers `false` to one that waits (`sync`); no name has a
`:`."""
LEAVE = 1.0
"""Wall seconds for the last receipts."""


class ProgramInbox(ReceiveOnce):
    """The incoming mail of one name; `file`, if there is one, keeps the numbers of the messages that are done with."""

    NOT_DONE = Refusal(code="not_absorbed", text="the program has not finished with it")

    def __init__(self, bus: Bus, name: str, file: Path | None) -> None:
        self._name, self._file = name, file
        self._waiting: deque[tuple[Message, float]] = deque()
        """The messages that the program is not done with, and when they expire; it may be working on the first one."""
        self._late: OrderedDict[tuple[Numbered, int], None] = OrderedDict()
        """The last messages that expired before the program read them."""
        self._asked: dict[str, asyncio.Future[Message]] = {}
        """The questions that wait for an answer."""
        self._answering = 0
        """Queries of commd without a receipt yet."""
        self._reader: Messages | None = None
        super().__init__(
            bus,
            name,
            self._taken_in,
            lambda: len(self._waiting) < ROOM,
            lambda: ASKING if self._asked else ANSWER_WITHIN,
        )
        if file is not None and file.exists():
            self.restore(read_numbers(file))

    def read(self) -> Messages:
        """Begin to read: first the messages that are not done with, then new ones."""
        self._reader = Messages(self)
        return self._reader

    def finish(self, message: Message) -> None:
        """Note that the program is done with the message that it is working on."""
        if self._waiting and self._waiting[0][0] is message:
            self._finish(message)
            self._waiting.popleft()
            self._pass_answers()

    @contextmanager
    def answer_to(self, question: str) -> Iterator[asyncio.Future[Message]]:
        """Wait for the answer to a question while the block runs."""
        loop = asyncio.get_running_loop()
        self._asked[question] = answer = loop.create_future()
        for bound in self._bounds:
            if not bound.expired():
                bound.reschedule(min(bound.when() or 0, loop.time() + ASKING))
        try:
            yield answer
        finally:
            del self._asked[question]

    @property
    def undone(self) -> int:
        """Number of received messages that the program is not done with."""
        return len(self._waiting)

    async def first(self, reader: Messages) -> Message:
        """Wait for the first message that is not done with, and return it."""
        while True:
            if reader is not self._reader:
                raise RuntimeError("another event loop reads the messages of this client now")
            while self._waiting and self._waiting[0][1] < asyncio.get_running_loop().time():
                self._late[_number(self._waiting.popleft()[0])] = None  # commd is answered so, and tells its sender
                if len(self._late) > ROOM:
                    self._late.popitem(last=False)
            self._pass_answers()
            if self._waiting:
                return self._waiting[0][0]
            await self._changed.wait()

    async def close(self) -> None:
        """Accept no more mail, and send the last receipts."""
        self.withdraw()
        self._leaving = True
        self._notify()
        with suppress(TimeoutError):
            async with asyncio.timeout(LEAVE):
                while self._answering:
                    await self._changed.wait()

    def _pass_answers(self) -> None:
        """Mark answers as done, also those that nobody waits for any more: no loop gets them. A number marks all
        below it as done: an answer waits for the earlier messages of its sender."""
        if not any(_is_answer(message) for message, _ in self._waiting):
            return
        left, held = deque[tuple[Message, float]](), set[tuple[str, str]]()
        for message, until in self._waiting:
            life = (message.sender, message.header.boot)
            if _is_answer(message) and life not in held:
                self._finish(message)
            else:
                left.append((message, until))
                held.add(life)
        self._waiting = left

    def _finish(self, message: Message) -> None:
        """Note that a message is done with. Raises OSError if the file cannot be written."""
        whose, seq = _number(message)
        self.done({whose: seq})
        if self._file is not None:
            done = {
                sender: {life: one.done for life, one in lives.items() if one.done}
                for sender, lives in self._progress.items()
            }
            replace_file(self._file, json.dumps(done).encode(), synced=False)

    def _taken_in(self, message: Message) -> Callable[[], None]:
        if not message.header.seq or message.receiver != self._name:
            expected = f"expected a numbered message to {self._name}, as commd hands it over"
            raise MessageRefused(Refusal(code="wrong_address", text=expected))
        if _number(message) in self._late:
            raise MessageRefused(EXPIRED)
        answer = self._asked.get(message.in_reply_to)
        if answer is not None and not answer.done() and not is_expired(message):
            answer.set_result(message)  # before there is room for the message: its asker waits for nothing else
        return partial(self._queue, message)

    def _queue(self, message: Message) -> None:
        until = float("inf") if message.ttl is None else asyncio.get_running_loop().time() + message.ttl
        self._waiting.append((message, until))

    async def _until_done(self, waits: Sequence[Waiting]) -> list[int]:
        self._pass_answers()
        self._notify()
        left = await super()._until_done(waits)
        return left + [one.place for one in waits if _number(one.message) in self._late]

    async def _receive(self, query: Query[Mail]) -> None:
        self._answering += 1
        try:
            await super()._receive(query)
        finally:
            self._answering -= 1
            self._notify()


class Messages:
    """An iterator for `async for`: asking for the next message marks the previous one as done."""

    def __init__(self, inbox: ProgramInbox) -> None:
        self._inbox = inbox
        self._in_hand: Message | None = None

    def __aiter__(self) -> Messages:
        return self

    async def __anext__(self) -> Message:
        if self._in_hand is not None:
            self._inbox.finish(self._in_hand)
            self._in_hand = None
        self._in_hand = await self._inbox.first(self)
        return self._in_hand


def _is_answer(message: Message) -> bool:
    """Return whether a message answers a question of `ask`, of this process or of one before it."""
    return message.in_reply_to.startswith(QUESTION)


def _number(message: Message) -> tuple[Numbered, int]:
    return Numbered(message.sender, message.header.boot), message.header.seq


def read_numbers(file: Path) -> dict[Numbered, int]:
    """Return the numbers of the messages that a program was done with; a file that cannot be read is set aside."""
    try:
        return {
            Numbered(str(sender), str(life)): int(number)
            for sender, lives in json.loads(file.read_text()).items()
            for life, number in lives.items()
        }
    except (ValueError, AttributeError, TypeError) as error:
        aside = file.with_name(file.name + ".corrupt")
        os.replace(file, aside)
        log.warning("numbers_unreadable set aside as %s: messages may come twice: %s", aside, error)
        return {}
