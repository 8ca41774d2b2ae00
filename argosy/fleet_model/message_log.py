"""The messages between agents as both ends tell of them: one letter for what was sent and received, for charts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from schemas.humanize import shortened
from schemas.wire.mind_records import Deed

MOST = 2_000
"""Letters that are kept."""


@dataclass
class LoggedMessage:
    """A message on its way from one agent to another. Times are Unix seconds; None = nobody told."""

    id: str
    sender: str
    receiver: str
    performative: str
    content: str
    number: int = 0
    """Of its last change: counts up over all letters."""
    sent: float | None = None
    received: float | None = None
    in_reply_to: str = ""
    undelivered: str = ""
    """Why it was given up; empty = it was not."""

    @property
    def state(self) -> Literal["in_flight", "received", "undelivered"]:
        """What became of it, as far as anybody told."""
        return "received" if self.received is not None else "undelivered" if self.undelivered else "in_flight"


class MessageLog:
    """Keeps the last letters by id, sender and receiver, in the order of their last changes."""

    def __init__(self, most: int = MOST) -> None:
        self.number = 0
        """Of the last change."""
        self._most = most
        self._letters: dict[tuple[str, str, str], LoggedMessage] = {}

    def __len__(self) -> int:
        return len(self._letters)

    def deed(self, agent: str, deed: Deed, at: float) -> LoggedMessage | None:
        """Take a deed of an agent. Returns its letter, or None if it has to do with none."""
        match deed.kind:
            case "sent" | "undelivered":
                letter = self._letter(deed, agent, deed.other)
                if deed.kind == "undelivered":
                    letter.undelivered = shortened(deed.reason) or "not delivered"
                elif letter.sent is None:
                    letter.sent = at
            case "received":
                letter = self._letter(deed, deed.other, agent)
                letter.received = at if letter.received is None else letter.received
            case _:
                return None
        return letter

    def since(self, number: int) -> list[LoggedMessage]:
        """Return the letters that came or changed after that number, in the order of their changes."""
        found: list[LoggedMessage] = []
        for letter in reversed(self._letters.values()):
            if letter.number <= number:
                break
            found.append(letter)
        return found[::-1]

    def give_up(self, before: float, why: str) -> None:
        """Say of each letter that is under way since before that time that nobody will tell what became of it."""
        for key, letter in list(self._letters.items()):
            if letter.state == "in_flight" and (letter.sent or 0.0) < before:
                self.number += 1
                letter.number, letter.undelivered = self.number, why
                self._letters[key] = self._letters.pop(key)

    def _letter(self, deed: Deed, sender: str, receiver: str) -> LoggedMessage:
        self.number += 1
        key = (shortened(deed.id) or f"#{self.number}", shortened(sender), shortened(receiver))
        letter = self._letters.pop(key, None) or LoggedMessage(*key, shortened(deed.performative), "")
        letter.number = self.number
        letter.content = letter.content or shortened(deed.text)
        letter.in_reply_to = letter.in_reply_to or shortened(deed.in_reply_to)
        self._letters[key] = letter
        if len(self._letters) > self._most:
            del self._letters[next(iter(self._letters))]
        return letter
