"""Send batches of mail to receivers of this board and to other boards, by queries."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from commd.bus.bus import Bus
from commd.bus.errors import BusClosed, QueryFailed, QueryTimeout
from commd.mail.age_clock import MailClock
from commd.mail.message import StoredMessage
from schemas.wire import keys
from schemas.wire.codec import BadRecord, TooDeep
from schemas.wire.records import Mail, Message, Receipt

ANSWER_TIMEOUT, SLOWEST = 5.0, 10_000
"""Wall seconds that another board has to commit a batch, and bytes per second of the slowest link: the time that the
batch and those before it take on such a link is added."""
ABSORB_TIMEOUT = 10.0
"""Wall seconds that a receiver has to take a batch."""
RECEIPT_SIZE = 64
"""Bytes of a receipt on the air."""

Deliver: TypeAlias = Callable[[tuple[Message, ...]], Awaitable[Receipt | None]]
"""Hands a batch to a receiver in this process; None = no answer, to be sent again."""


@dataclass(frozen=True)
class NotTaken:
    """A batch that was not taken, as far as is known."""

    why: str
    """For people."""
    certain: bool
    """Whether nothing was taken for certain: the batch was not sent, or there was no receiver."""
    away: bool = False
    """Whether the peer is away, for all its lines."""
    unreadable: bool = False
    """Whether the peer can never read some message of the batch."""


class Directory(Protocol):
    """Knows the receivers of mail."""

    def board_of(self, name: str) -> str | None:
        """Return the board whose commd stores the mail of an agent, a client or a node; None for an unknown name."""
        ...

    def names(self) -> Collection[str]:
        """Return all receivers, present or away."""
        ...


class FixedDirectory:
    """A directory of fixed names: those of the mission."""

    def __init__(self, mailboxes: Mapping[str, str]) -> None:
        self._mailboxes = dict(mailboxes)

    def board_of(self, name: str) -> str | None:
        """Return the board of a name."""
        return self._mailboxes.get(name)

    def names(self) -> Collection[str]:
        """Return all names."""
        return self._mailboxes


class Air(Protocol):
    """A model of the radio between two boards."""

    async def carries(self, sender: str, receiver: str, size: int) -> bool:
        """Wait for one transmission of `size` bytes. Returns whether it arrived."""
        ...


class Peers:
    """Receivers of this board and other boards: which are alive, and how a batch gets there."""

    def __init__(self, bus: Bus, clock: MailClock, directory: Directory, air: Air | None) -> None:
        self.directory, self.air = directory, air
        self.attached: dict[str, Deliver] = {}
        """Receivers in this process."""
        self._bus, self._clock = bus, clock
        self._in_flight: Counter[str] = Counter()
        """Bytes of the batches that wait for their receipts, by board."""
        self._alive: defaultdict[str, set[str]] = defaultdict(set)

    def watch(self, arrived: Callable[[str], None]) -> None:
        """Watch the fleet's liveliness tokens; call `arrived(name)` when a board or a receiver appears."""

        def token(key: str, alive: bool) -> None:
            parsed = keys.parse(key)
            if parsed is None or len(parsed[2]) != 3:  # an `alive/**` key that is not a daemon's
                return
            _, name, (_, daemon, boot) = parsed
            if daemon == "bridged" or daemon == "argosy":
                return
            if alive:
                self._alive[name].add(f"{daemon}/{boot}")
                arrived(name)
            elif name in self._alive:
                self._alive[name].discard(f"{daemon}/{boot}")
                if not self._alive[name]:
                    del self._alive[name]

        self._bus.watch(keys.alive(self._bus.fleet, "*", "*", "*"), token)

    def of(self, line: str) -> str:
        """Return the peer that takes the mail of a line: a receiver of this board, or another board."""
        _, remote, receiver = line.partition(">")
        return (self.directory.board_of(receiver) or receiver) if remote else line

    def group_of(self, line: str) -> str:
        """Return what a line hangs with: the process of its receiver on this board, or another board."""
        peer = self.of(line)
        if ">" not in line and len(alive := self._alive.get(peer, ())) == 1:
            return next(iter(alive))
        return peer

    async def carry(self, line: str, batch: Sequence[StoredMessage]) -> Receipt | NotTaken:
        """Send a batch of a line to its peer."""
        now = self._clock.now()
        if (deliver := self.attached.get(line)) is not None:
            receipt = await deliver(tuple(one.read(now) for one in batch))
            return receipt or NotTaken(f"{line} does not answer", certain=False)
        mail, peer = Mail(messages=tuple(one.carried(now) for one in batch)), self.of(line)
        sender, remote, receiver = line.partition(">")
        size = sum(len(one.message) for one in batch) if remote else 0
        air = self.air if remote else None
        if air is not None and not await air.carries(sender, receiver, size):
            return NotTaken("lost on the air", certain=True)
        self._in_flight[peer] += size
        if remote:
            key = keys.mail(self._bus.fleet, receiver, sender)
            timeout = ANSWER_TIMEOUT + self._in_flight[peer] / SLOWEST
        else:
            key, timeout = keys.inbox(self._bus.fleet, line), ABSORB_TIMEOUT
        there = peer in self._alive
        try:
            receipt = await self._bus.ask_one(key, mail, Receipt, timeout)
        except BusClosed as closed:
            return NotTaken(str(closed), certain=True)
        except BadRecord as bad:
            return NotTaken(f"it cannot be written: {bad}", certain=True, unreadable=True)
        except QueryTimeout as timed_out:
            if not timed_out.nobody:
                return NotTaken(f"{peer}: {timed_out}", certain=False)
            if there or peer in self._alive:
                # A router that denies a query ends it at once, as it does when nobody serves the key.
                denied = ": or does its router deny it?" if self._clock.now() - now < timeout / 2 else ""
                return NotTaken(f"{peer} does not answer{denied}", certain=False)
            return NotTaken(f"{peer} is away", certain=True, away=True)
        except QueryFailed as failed:
            return NotTaken(f"{peer} does not take it: {failed}", certain=False, unreadable=failed.code == TooDeep.code)
        finally:
            self._in_flight[peer] -= size
        if air is not None and not await air.carries(receiver, sender, RECEIPT_SIZE):
            return NotTaken("its receipt was lost on the air", certain=False)
        return receipt
