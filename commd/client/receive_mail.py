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
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

from commd.bus.bus import Bus, Query
from commd.client.receive_once import EXPIRED, MessageRefused, Numbered, ReceiveOnce, is_expired
from commd.process.state_dir import make_private_file
from schemas.wire.records import Mail, Message, Refusal

log = logging.getLogger("inbox")

ANSWER_WITHIN = 2.0
"""Wall seconds after which `commd` is told how far the program has come; what it is not done with is offered again."""
ASKING = 0.05
"""The same while it waits for an answer: that may stand behind what `commd` is told of."""
ROOM = 10_000
"""Messages that wait here for the program at most; the others wait at `commd`."""
QUESTION = "sync:"
"""What the ids of a program's questions begin with: an agent answers `false` to who waits (`sync`); no name has `:`."""
LEAVE = 1.0
"""Wall seconds for the last answers."""


class ProgramInbox(ReceiveOnce):
    """The incoming mail of one name; the numbers of what is done with are in `file`, if there is one."""

    NOT_DONE = Refusal(code="not_absorbed", text="the program is not done with it")

    def __init__(self, bus: Bus, name: str, file: Path | None) -> None:
        self._name, self._file = name, file
        self._waiting: deque[tuple[Message, float]] = deque()
        """What the program is not done with, and when it expires; the first one may be in its hands."""
        self._late: OrderedDict[tuple[Numbered, int], None] = OrderedDict()
        """The last ones whose time was over before the program came to them."""
        self._asked: dict[str, asyncio.Future[Message]] = {}
        """The questions whose answers are waited for."""
        self._answering = 0
        """Queries of commd that are not answered yet."""
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
        """Begin to read: the messages that are not done with, and then those that come."""
        self._reader = Messages(self)
        return self._reader

    def done(self, message: Message) -> None:
        """The program is done with the message that it has in hand."""
        if self._waiting and self._waiting[0][0] is message:
            self._finish(message)
            self._waiting.popleft()
            self._pass_answers()
            self._notify()

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
        """Messages that have come and that the program is not done with."""
        return len(self._waiting)

    async def first(self, reader: Messages) -> Message:
        """Wait for the first message that is not done with; it stays the first until it is."""
        while True:
            if reader is not self._reader:
                raise RuntimeError("another loop reads the messages of this client by now")
            while self._waiting and self._waiting[0][1] < asyncio.get_running_loop().time():
                self._late[_number(self._waiting.popleft()[0])] = None  # commd is answered so, and tells its sender
                if len(self._late) > ROOM:
                    self._late.popitem(last=False)
            self._pass_answers()
            if self._waiting:
                return self._waiting[0][0]
            await self._changed.wait()

    async def close(self) -> None:
        """Take no mail any more; answer how far the program has come."""
        self.withdraw()
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
                self._finish(message)
            else:
                left.append((message, until))
                held.add(life)
        self._waiting = left

    def _finish(self, message: Message) -> None:
        """The program is done with a message. Raises OSError if that cannot be written down."""
        self._done(*_number(message))
        if self._file is not None:
            done = {
                sender: {life: one.done for life, one in lives.items() if one.done}
                for sender, lives in self._progress.items()
            }
            fresh = self._file.with_name(self._file.name + ".new")
            make_private_file(fresh)
            fresh.write_text(json.dumps(done))
            os.replace(fresh, self._file)

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

    async def _until_done(self, waits: Mapping[int, tuple[Numbered, int]]) -> list[int]:
        self._pass_answers()
        self._notify()
        return await super()._until_done(waits)

    def _is_done(self, whose: Numbered, seq: int) -> bool:
        return (whose, seq) not in self._late and super()._is_done(whose, seq)

    async def _receive(self, query: Query[Mail]) -> None:
        self._answering += 1
        try:
            await super()._receive(query)
        finally:
            self._answering -= 1
            self._notify()


class Messages:
    """What `async for` goes through: to ask for the next message is to be done with the one before."""

    def __init__(self, inbox: ProgramInbox) -> None:
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


def _number(message: Message) -> tuple[Numbered, int]:
    return Numbered(message.sender, message.header.boot), message.header.seq


def read_numbers(file: Path) -> dict[Numbered, int]:
    """Return the numbers of what a program was done with; a file that cannot be read is set aside."""
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
