"""An agent's incoming mail: each message once, and acknowledged when its effects are on disk.

A message is *fed* to the mind, *absorbed* when the mind has taken it in a cycle, and *kept* when a checkpoint that
holds what came of it is on disk (`absorb` and `kept`); only then commd is answered that it is taken.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from commd.bus.bus import Bus
from commd.client.receive_once import Numbered, ReceiveOnce
from schemas.wire.records import Message, Refusal

PATIENCE = 5.0
"""Wall seconds for which an answer to commd waits for the mind and the disk; then the rest is to be sent again."""


class AgentInbox(ReceiveOnce):
    """What comes in for one agent."""

    FULL = Refusal(code="mailbox_full", text="the mailbox of the mind is full")
    NOT_DONE = Refusal(code="not_absorbed", text="the mind has not absorbed it")

    def __init__(
        self,
        bus: Bus,
        agent: str,
        room: Callable[[], bool],
        read: Callable[[Message], Callable[[], None]],
        missing: Callable[[str, int], None],
    ) -> None:
        self._waiting: deque[tuple[Numbered, int]] = deque()
        """What is in the mind's mailbox, in its order; number 0: a message without one."""
        self._absorbed: dict[Numbered, int] = {}
        """What the mind has taken and no save has begun to hold."""
        super().__init__(bus, agent, read, room, lambda: PATIENCE, missing)

    def _handed_over(self, whose: Numbered, seq: int) -> None:
        self._waiting.append((whose, seq))

    def unnumbered(self) -> None:
        """A message that does not come from commd was put into the mind's mailbox."""
        self._waiting.append((_NOBODY, 0))

    def absorb(self, left: int) -> bool:
        """The mind has so many messages left in its mailbox. Returns whether a save is due that somebody waits for."""
        while len(self._waiting) > left:
            whose, seq = self._waiting.popleft()
            if seq:
                self._absorbed[whose] = seq
        return bool(self._absorbed)

    def taken_last(self, left: int) -> tuple[str, str, int] | None:
        """The last message that the mind, which has so many left, has taken and no save has begun to hold."""
        place = len(self._waiting) - left - 1
        if place >= 0 and self._waiting[place][1]:
            whose, seq = self._waiting[place]
        elif self._absorbed:
            whose, seq = next(reversed(self._absorbed.items()))
        else:
            return None
        return whose.sender, whose.numbering, seq

    def take_absorbed(self) -> dict[Numbered, int]:
        """Return what a save that begins now has to hold; `kept` is to be called when it does."""
        found, self._absorbed = self._absorbed, {}
        return found

    def kept(self, numbers: Mapping[Numbered, int]) -> None:
        """What came of the messages up to these numbers is on disk: they are taken."""
        for whose, seq in numbers.items():
            self._done(whose, seq)
        if numbers:
            self._notify()


_NOBODY = Numbered("", "")
