"""Messages between agents as both ends report them: one entry for what was sent and what was received."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

from schemas.humanize import LONGEST, shortened
from schemas.wire.mind_records import ActivityEvent

MOST = 2_000
"""Messages that are kept, unless another number is given."""


@dataclass
class LoggedMessage:
    """A message from one agent to another. Times are seconds of the model's clock; None = not reported."""

    id: str
    sender: str
    receiver: str
    performative: str
    content: str
    number: int
    """Counts up from 1, in the order in which messages were first reported."""
    reported: float = 0.0
    """When it was first reported."""
    sent: float | None = None
    received: float | None = None
    in_reply_to: str = ""
    undelivered: str = ""
    """Why it was given up; it may have arrived all the same. Empty = it is received, or on its way."""

    @property
    def at(self) -> float:
        """When it was first seen: sent, received or else reported."""
        return min((time for time in (self.sent, self.received) if time is not None), default=self.reported)


class MessageLog:
    """Keeps the last messages by id, sender and receiver, in the order in which they were first reported."""

    def __init__(self, most: int = MOST, longest: int = LONGEST) -> None:
        """`most`: messages that are kept; `longest`: characters of a message's content that are kept."""
        self._number = 0
        """Of the last message."""
        self.forgotten = 0
        """Messages that are no longer kept."""
        self._most, self._longest = most, longest
        self._messages: dict[tuple[str, str, str], LoggedMessage] = {}

    def __len__(self) -> int:
        return len(self._messages)

    def event(self, agent: str, event: ActivityEvent, at: float) -> LoggedMessage | None:
        """Take an event of an agent at `at`. Returns its message, or None if it is not about one."""
        match event.kind:
            case "sent" | "undelivered":
                message = self._message(event, agent, event.other, at)
                if event.kind == "undelivered":
                    message.undelivered = shortened(event.reason) or "not delivered"
                elif message.sent is None:
                    message.sent = at
            case "received":
                message = self._message(event, event.other, agent, at)
                message.received = at if message.received is None else message.received
            case _:
                return None
        if message.sent is not None and message.received is not None:
            message.received = max(message.sent, message.received)  # the two times are estimates
        return message

    def newest(self, most: int | None = None) -> list[LoggedMessage]:
        """Return the messages that were first reported last, at most `most`, the oldest first; None: all."""
        return list(islice(reversed(self._messages.values()), most))[::-1]

    def give_up(self, before: float, why: str) -> None:
        """Mark each message that is on its way since before `before` as undelivered, for the reason `why`."""
        for message in self._messages.values():
            if message.received is None and not message.undelivered and (message.sent or 0.0) < before:
                message.undelivered = why

    def _message(self, event: ActivityEvent, sender: str, receiver: str, at: float) -> LoggedMessage:
        key = (shortened(event.id) or f"#{self._number + 1}", shortened(sender), shortened(receiver))
        message = self._messages.get(key)
        if message is None:
            self._number += 1
            message = LoggedMessage(*key, shortened(event.performative), "", self._number, at)
            self._messages[key] = message
            if len(self._messages) > self._most:
                del self._messages[next(iter(self._messages))]
                self.forgotten += 1
        message.content = message.content or shortened(event.text, self._longest)
        message.in_reply_to = message.in_reply_to or shortened(event.in_reply_to)
        return message
