"""Boards with their mail in one process, and agents as small as can be: they post, and keep what they are handed."""

import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from commd.bus.bus import Bus, Query
from commd.bus.errors import QueryFailed
from commd.mail.age_clock import MailClock
from commd.mail.delivery import Air
from commd.mail.service import MailService, open_mail_service
from schemas.mission.model import MailRules
from schemas.wire import keys
from schemas.wire.records import Header, Mail, Mailboxes, Message, Receipt
from tests.support.buses import FLEET, Connect, served

TWO_BOARDS = {"a": "pi1", "b": "pi2", "c": "pi1"}
"""Agents a and c live on board pi1, b on pi2."""


class Time:
    """The kernel's clock since boot, which only a test moves on."""

    def __init__(self) -> None:
        self.seconds = 100.0

    def __call__(self) -> float:
        return self.seconds


@asynccontextmanager
async def board(
    connect: Connect,
    name: str,
    folder: Path,
    *,
    homes: dict[str, str] | None = None,
    rules: MailRules = MailRules(),  # noqa: B008 (it cannot be changed)
    air: Air | None = None,
    now: Callable[[], float] | None = None,
) -> AsyncIterator[MailService]:
    """Open a board's mail, with a session of its own and the token by which other boards know that it is there."""
    bus = await connect(name, "commd")
    clock = MailClock(now, "this boot") if now is not None else None
    homes = TWO_BOARDS if homes is None else homes
    async with open_mail_service(bus, homes, rules, folder, air, clock) as mail_service:
        token = bus.token(keys.alive(FLEET, name, "commd", bus.boot))
        yield mail_service
        bus.withdraw(token)
        for agent in list(mail_service._hosted):
            for withdraw in mail_service._hosted.pop(agent):
                withdraw()
    await bus.close()


def message(number: int, sender: str = "a", receiver: str = "b", life: str = "life1", **fields: Any) -> Message:
    """A numbered message whose content is its number."""
    return Message(
        header=Header(seq=number, boot=life, source=sender, stamp=time.time_ns()),
        id=f"{sender}.{number}",
        sender=sender,
        performative=fields.pop("performative", "tell"),
        receiver=receiver,
        content=fields.pop("content", number),
        **fields,
    )


async def ask(bus: Bus, key: str, *messages: Message) -> Receipt | str:
    """Ask `key` with a batch. Returns the receipt, or in words why there is none."""
    try:
        return await bus.ask_one(key, Mail(messages=messages), Receipt, 60)
    except QueryFailed as failed:
        return str(failed)


async def post(bus: Bus, *messages: Message) -> Receipt | str:
    outbox = keys.outbox(FLEET, messages[0].sender)
    await served(bus, outbox)
    return await ask(bus, outbox, *messages)


async def listed(bus: Bus, name: str) -> Mailboxes:
    """Return what waits at a board, as an operator sees it."""
    return await bus.ask_one(keys.mailboxes(FLEET, name), None, Mailboxes, 60)


class Receiver:
    """An agent that takes what it has not taken yet and keeps it."""

    def __init__(self, bus: Bus, name: str, answer: Callable[[Mail], Receipt | None] | None = None) -> None:
        """`answer(batch)` says what becomes of a batch instead: a receipt, or no word."""
        self.batches: list[tuple[Message, ...]] = []
        """All that it was handed, what it knew already too."""
        self.got: list[Message] = []
        self._answer = answer
        self._last: dict[tuple[str, str], int] = {}
        self._bus, self._name = bus, name
        self._leave = bus.serve(keys.inbox(FLEET, name), Mail, self._take)
        self._token = bus.token(keys.alive(FLEET, name, "agentd", bus.boot))

    @property
    def contents(self) -> list[Any]:
        return [one.content for one in self.got]

    def leave(self) -> None:
        """Be away from now on."""
        self._leave()
        self._bus.withdraw(self._token)

    async def _take(self, query: Query[Mail]) -> None:
        if query.record is None:
            query.reply_error(query.error)
            return
        batch = query.record.messages
        self.batches.append(batch)
        receipt = Receipt(taken=len(batch)) if self._answer is None else self._answer(query.record)
        if receipt is None:
            return
        for place, one in enumerate(batch):
            numbering = one.sender, one.header.boot
            new = one.header.seq > self._last.get(numbering, 0)
            if place not in receipt.refused and place not in receipt.later and new:
                self._last[numbering] = one.header.seq
                self.got.append(one)
        query.reply(receipt)
