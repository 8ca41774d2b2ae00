"""Send mail: give messages to the board's `commd`, which has them on disk when it sends the receipt."""

from __future__ import annotations

import asyncio
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from math import inf
from typing import cast

import msgspec
from msgspec.structs import replace

from commd.bus.bus import Bus
from commd.bus.errors import BusError, QueryFailed
from commd.mail.message import LARGEST, adds_up
from schemas.files.findings import nearest
from schemas.mission.model import PERFORMATIVES
from schemas.wire import keys
from schemas.wire.codec import BadRecord, Wire, codec
from schemas.wire.records import Header, Mail, Message, Receipt, Refusal
from schemas.wire.terms import Number, Term, term_of

ANSWER_TIMEOUT = 8.0
"""Wall seconds that `commd` has for one answer: a full disk is waited for there."""
RETRY = 0.2
CLOSE = 0.8
"""Least similarity of a misspelt performative with a known one."""


class Unsendable(ValueError):
    """A message that cannot be sent: its refusal has a code and a text."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.reason = Refusal(code=code, text=text)


class NotSent(Exception):
    """A message that was not accepted; the text has the reason."""

    def __init__(self, message: Message, reason: str) -> None:
        super().__init__(f"{message.performative} to {message.receiver}: {reason}")
        self.message, self.reason = message, reason


class UnknownReceiver(NotSent, LookupError):
    """No board knows an agent of that name."""


class TooLarge(NotSent, ValueError):
    """The message is larger than 1 MB."""


class NotSendable(NotSent, ValueError):
    """The message cannot be written or understood: nested too deeply, no Unicode, NaN, a misspelt performative."""


class MailboxFull(NotSent):
    """The mailbox of the receiver is full; no waiting message is dropped for a new one."""


class SendTimeout(NotSent, TimeoutError):
    """`commd` has not acknowledged the message. `send_again` sends it again with its number, so that it arrives
    once."""


def encoded(message: Message, wire: Wire) -> bytes:
    """Return a message as it is sent. Raises Unsendable for one that is too large or cannot be encoded."""
    try:
        data = codec(Message).encode(message, wire)
    except BadRecord as bad:
        raise Unsendable("not_sendable", str(bad)) from None
    if len(data) > LARGEST:
        raise Unsendable("message_too_large", f"{len(data)} bytes, expected at most {LARGEST} (1 MB)")
    return data


async def hand_to_commd(bus: Bus, sender: str, messages: Sequence[bytes], timeout: float) -> Receipt:
    """Give a batch of encoded messages to the board's `commd`, and return its receipt once the batch is on disk.

    Raises BusError if there is none within `timeout` wall seconds, or one that does not add up.
    """
    key = keys.outbox(bus.fleet, sender)
    mail = Mail(messages=cast(tuple[Message, ...], tuple(map(msgspec.Raw, messages))))
    receipt = await bus.ask_one(key, mail, Receipt, timeout)
    if not adds_up(receipt, len(messages)):
        raise QueryFailed(key, f"the receipt does not account for all {len(messages)} messages")
    return receipt


class Sending:
    """The outgoing mail of one name; its messages to each receiver are numbered, and sent one after another."""

    def __init__(self, bus: Bus, name: str) -> None:
        self._bus, self._name = bus, name
        self._last: dict[str, Message] = {}
        """The last message to each receiver."""
        self._numbers: Counter[str] = Counter()
        """The number of the last message to each receiver that `commd` has, or may have."""
        self._turn: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    async def send(
        self,
        receiver: str,
        performative: str,
        content: object,
        ttl: float | None,
        in_reply_to: str,
        patience: float,
        identity: str = "",
        until: float = inf,
    ) -> Message:
        """Send a message and return it once it is on disk. Raises the subclass of NotSent for the reason, and
        TypeError for a content that cannot be a term.

        `ttl` is in wall seconds, None = for ever; `commd` has `patience` wall seconds to take it. `identity` is its id;
        none = one that is made of its number. It is given up `until` a time of the loop's clock, also when its turn has
        not come: then it has not left.
        """
        message = Message(
            id=identity,
            sender=self._name,
            performative=performative,
            receiver=receiver,
            content=cast(Term, content),
            in_reply_to=in_reply_to,
            ttl=ttl,
        )
        message = _checked(message)
        turn = self._turn[receiver]
        try:
            async with asyncio.timeout_at(None if until == inf else until):
                await turn.acquire()
        except TimeoutError:
            raise NotSent(message, f"commd has not answered for an earlier message ({patience:g} s)") from None
        try:
            seq, bus = self._numbers[receiver] + 1, self._bus
            header = Header(seq=seq, stamp=time.time_ns(), source=self._name, boot=bus.boot)
            made = identity or f"{self._name}.{header.boot}.{receiver}.{header.seq}"
            message = replace(message, header=header, id=made)
            self._last[receiver] = message
            await self._hand_over(message, patience, until)
            return message
        finally:
            turn.release()

    async def send_again(self, message: Message, patience: float) -> None:
        """Send a message that had no answer, within `patience` wall seconds.

        Raises NotSent, and ValueError if another one to its receiver went after it.
        """
        async with self._turn[message.receiver]:
            if self._last.get(message.receiver) is not message:
                raise ValueError(f"{message.id}: another message to {message.receiver} has been sent since")
            await self._hand_over(message, patience)

    async def _hand_over(self, message: Message, patience: float, until: float = inf) -> None:
        try:
            data = encoded(message, self._bus.wire)
        except Unsendable as bad:
            kind = TooLarge if bad.reason.code == "message_too_large" else NotSendable
            raise kind(message, str(bad)) from None
        loop = asyncio.get_running_loop()
        until = min(until, loop.time() + patience)
        while True:
            left = until - loop.time()
            reason, full = await self._ask(message, data, min(ANSWER_TIMEOUT, max(RETRY, left)))
            if not reason:
                return
            if loop.time() + RETRY >= until:
                raise MailboxFull(message, reason) if full else SendTimeout(message, f"{reason} ({patience:g} s)")
            await asyncio.sleep(RETRY)

    async def _ask(self, message: Message, data: bytes, timeout: float) -> tuple[str, bool]:
        """Give a message to `commd` once. Returns why it was not taken yet, and whether that is for want of room.

        Its number is used up unless `commd` certainly does not have it: a receiver would miss it.
        """
        receiver = message.receiver
        before, self._numbers[receiver] = self._numbers[receiver], message.header.seq
        try:
            receipt = await hand_to_commd(self._bus, self._name, [data], timeout)
        except BusError as error:
            return f"commd: {error}", False
        if receipt.refused or receipt.later:
            self._numbers[receiver] = before
        if receipt.refused:
            raise _for_good(message, receipt.refused[0])
        if receipt.later:
            return str(receipt.later[0]), receipt.later[0].code == "mailbox_full"
        return "", False


def _checked(message: Message) -> Message:
    """Return a message with its content as a term. Raises NotSendable, and TypeError for what cannot be a term."""
    if meant := nearest(message.performative, PERFORMATIVES, CLOSE):
        raise NotSendable(message, f"no performative `{message.performative}`, expected `{meant}` or one of your own")
    try:
        content = term_of(message.content)
    except RecursionError:
        raise NotSendable(message, "the content is nested too deeply to be sent") from None
    if content == Number("NaN"):
        raise NotSendable(message, "the content is NaN, expected a number or another term")
    return replace(message, content=content)


def _for_good(message: Message, why: Refusal) -> NotSent:
    """Return the error for a message that is refused for good."""
    match why.code:
        case "receiver_not_found":
            return UnknownReceiver(message, f"nobody knows an agent `{message.receiver}`")
        case "message_too_large":
            return TooLarge(message, str(why))
        case _:
            return NotSent(message, str(why))
