"""The gateway to Comm nodes of the paper (section 4.4): UDP datagrams `<id,sender,itlforce,receiver,data>`, both ways.

UDP guarantees nothing and old nodes acknowledge nothing, so a sent message counts as delivered. A node's message is
accepted when it is on disk. Datagrams are untrusted: bad ones are counted and logged.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import re
import socket
import time
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager

from msgspec.structs import replace

from commd.common.repeated_log import is_logged
from commd.mail.message import undelivered
from commd.mail.service import MailService
from commd.mail.store import StoreFailed
from schemas.files.findings import Findings
from schemas.files.units import host_and_port
from schemas.mission import model
from schemas.mission.model import Mission
from schemas.wire.records import Health, Message, Receipt, Refusal
from schemas.wire.term_text import BadTerm, read, write

log = logging.getLogger("gateway")

MAX_DATAGRAM = 1024
"""Bytes that an old Comm node reads of a datagram; it would cut off the rest."""
MAX_HEARD = 4096
"""Bytes of the largest datagram that is read; nodes that follow the protocol send no larger ones."""
EVERYBODY = "null"
"""The receiver of a broadcast: Jason writes none as this."""
QUEUE = 1000
"""Datagrams that may wait for the disk; further ones are dropped and counted."""
BATCH = 64
PACE = 0.002
"""Seconds between two datagrams to one node: old nodes read one at a time and lose what does not fit their buffer."""
DISK_RETRY = 1.0
"""Seconds between two attempts while the disk fails."""
SEEK_EVERY = 10.0
"""Seconds between two lookups of a node whose host has no address yet."""
MAX_SOURCES = 1000
LONGEST_LOGGED = 200
"""Characters of a logged reason."""
RATE, BURST = 200.0, 400.0
"""Datagrams of one node: per second, and in a burst; further ones are dropped unread and counted."""
REPEATED_WITHIN = 60.0
"""Seconds within which an equal datagram is a repetition; not longer, as Jason's ids restart with each process."""
REMEMBERED = 10_000
_FIELD = re.compile(r"[^,<>\s]+")


class BadDatagram(ValueError):
    """Text that is not a message; says which part and what was expected."""


def write_message(message: Message) -> str:
    """Return a message in the paper's form. Raises BadDatagram for names that the form cannot carry."""
    head = f"{message.id}->{message.in_reply_to}" if message.in_reply_to else message.id
    fields = {"sender": message.sender, "performative": message.performative, "receiver": message.receiver}
    for what, text in {"id": message.id, **fields}.items():
        if not _FIELD.fullmatch(text) or "->" in text:
            raise BadDatagram(f"{what}: expected a text without blanks, `,`, `<` or `>`, got `{text}`")
    return "<" + ",".join([head, *fields.values(), write(message.content)]) + ">"


def read_message(text: str) -> Message:
    """Return the message that `text` is. Raises BadDatagram that says what was expected."""
    text = text.strip()
    if not (text.startswith("<") and text.endswith(">")):
        raise BadDatagram("expected `<id,sender,itlforce,receiver,data>`")
    parts = text[1:-1].split(",", 4)
    if len(parts) != 5:
        raise BadDatagram(f"expected five fields `<id,sender,itlforce,receiver,data>`, got {len(parts)}")
    head, sender, performative, receiver = (part.strip() for part in parts[:4])
    identity, _, in_reply_to = head.partition("->")
    named = {"id": identity, "sender": sender, "performative": performative, "receiver": receiver}
    for what, value in named.items():
        if not _FIELD.fullmatch(value):
            raise BadDatagram(f"{what}: expected a name, got `{value}`")
    try:
        content = read(parts[4].strip())
    except BadTerm as error:
        raise BadDatagram(f"data: {error}") from None
    return Message(
        id=identity,
        sender=sender,
        performative=performative,
        receiver=receiver,
        content=content,
        in_reply_to=in_reply_to,
    )


class Allowance:
    """A token bucket of datagrams from one host, by the number of its nodes."""

    def __init__(self) -> None:
        self.nodes = 1
        self._left, self._since = BURST, 0.0

    def take(self, now: float) -> bool:
        """Take one datagram from it at `now`, in monotonic seconds. Returns whether it was left."""
        self._left = min(BURST * self.nodes, self._left + (now - self._since) * RATE * self.nodes)
        self._since = now
        if self._left < 1:
            return False
        self._left -= 1
        return True


class Node:
    """An agent behind an old Comm node."""

    def __init__(self, name: str, address: str) -> None:
        self.name, self.address = name, address
        self.at: tuple[str, int] | None = None
        """IP address and port, once its host is found."""
        self.missed = False
        """Whether it was logged that its host is not found."""
        self._heard: OrderedDict[bytes, float] = OrderedDict()

    def repeats(self, payload: bytes, now: float) -> bool:
        """Return whether it sent the same datagram within `REPEATED_WITHIN`; `now` in monotonic seconds."""
        heard, digest = self._heard, hashlib.blake2b(payload, digest_size=16).digest()
        while heard and (len(heard) > REMEMBERED or now - next(iter(heard.values())) > REPEATED_WITHIN):
            heard.popitem(last=False)
        known = digest in heard
        heard.setdefault(digest, now)
        return known


class Gateway(asyncio.DatagramProtocol):
    """Exchanges mail with the nodes of the mission. Make it with `open_gateway`."""

    def __init__(self, nodes: Mapping[str, str], now: Callable[[], float] = time.monotonic) -> None:
        self.nodes = {name: Node(name, address) for name, address in nodes.items()}
        self.counters: Counter[str] = Counter()
        """gateway_in, gateway_out, gateway_malformed, gateway_strangers, gateway_repeated, gateway_dropped,
        gateway_refused, gateway_unsendable, gateway_errors: datagrams so far."""
        self._now = now
        self._hosts: dict[str, Allowance] = {}
        """Allowances of the hosts of nodes."""
        self._waiting: asyncio.Queue[Message] = asyncio.Queue(QUEUE)
        self._strangers: set[str] = set()
        self._transport: asyncio.DatagramTransport | None = None
        self._family = socket.AF_UNSPEC

    async def open(self, listen: str) -> None:
        """Look up the nodes' hosts and listen. Raises OSError if the address is not available."""
        host, port = host_and_port(listen)
        loop = asyncio.get_running_loop()
        ours = await loop.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_DGRAM)
        self._family = ours[0][0]
        await self._find_nodes()
        self._transport, _ = await loop.create_datagram_endpoint(
            lambda: self, local_addr=(host.strip("[]"), port), family=self._family
        )

    async def run(self, mail_service: MailService) -> None:
        """Exchange mail between the nodes and `mail_service`, for ever."""
        detach = [mail_service.attach(name, self.deliver) for name in self.nodes]
        try:
            await asyncio.gather(self._take(mail_service), self._seek())
        finally:
            for end in detach:
                end()

    def health(self) -> Health:
        """Return the counts of datagrams for the daemon's health."""
        counters = {name: float(count) for name, count in sorted(self.counters.items())}
        dropped, bad = self.counters["gateway_dropped"], self.counters["gateway_malformed"]
        return Health(counters=counters, drops=dropped, bad_input=bad)

    def close(self) -> None:
        """Close the socket."""
        if self._transport is not None:
            self._transport.close()

    def error_received(self, exc: Exception) -> None:
        """Count a datagram that the system could not send."""
        self.counters["gateway_errors"] += 1
        log.debug("not_sent why=%s", exc)

    def datagram_received(self, data: bytes, addr: tuple[str, int] | tuple[str, int, int, int]) -> None:
        """Queue a node's datagram."""
        self.counters["gateway_in"] += 1
        host, now = addr[0], self._now()
        allowance = self._hosts.get(host)
        if allowance is None:
            self._refuse(host, f"datagrams from {host}: no node of the mission is there")
            return
        if not allowance.take(now):
            self._count("dropped", f"source={host}: more than {RATE * allowance.nodes:g} datagrams a second")
            return
        try:
            if len(data) > MAX_HEARD:
                raise BadDatagram(f"expected at most {MAX_HEARD} bytes")
            message = read_message(data.rstrip(b"\0").decode())
        except (BadDatagram, UnicodeDecodeError) as bad:
            self._count("malformed", f"source={host}:{addr[1]} {len(data)} bytes: {bad}")
            return
        node = self.nodes.get(message.sender)
        if node is None or node.at is None or node.at[0] != host:
            why = "no node of the mission" if node is None else f"its node is at {node.address}"
            self._refuse(f"{message.sender} {host}", f"sender={message.sender} from {host}: {why}")
        elif self._waiting.full():
            self._count("dropped", f"sender={node.name}: {QUEUE} datagrams wait")
        elif node.repeats(data, now):
            self.counters["gateway_repeated"] += 1
        else:
            self._waiting.put_nowait(message)

    async def _seek(self) -> None:
        """Look up nodes that are not found yet, for ever."""
        while True:
            await asyncio.sleep(SEEK_EVERY)
            await self._find_nodes()

    async def _take(self, mail_service: MailService) -> None:
        """Hand the nodes' messages to the mail service, for ever."""
        while True:
            messages = [await self._waiting.get()]
            while len(messages) < BATCH and not self._waiting.empty():
                messages.append(self._waiting.get_nowait())
            batch = [one for message in messages for one in _addressed(message, mail_service.homes)]
            receipt = await self._hand_over(batch, mail_service)
            for place, reason in (receipt.refused | receipt.later).items():
                self.counters["gateway_refused"] += 1
                self._report_undelivered(batch[place], reason)

    async def _hand_over(self, batch: list[Message], mail_service: MailService) -> Receipt:
        """Hand a batch to the mail service, and retry while the disk fails."""
        while True:
            try:
                return await mail_service.take(batch)
            except StoreFailed as failed:
                log.debug("not_taken messages=%d why=%s", len(batch), failed)
            except Exception as error:  # a defect in one batch must not stop the others
                log.exception("defect in argosy: %d messages of nodes are lost", len(batch))
                defect = Refusal(code="defect", text=f"{type(error).__name__}: {error}")
                return Receipt(refused=dict.fromkeys(range(len(batch)), defect))
            await asyncio.sleep(DISK_RETRY)

    async def deliver(self, batch: tuple[Message, ...]) -> Receipt | None:
        """Send a batch to the node of its receiver; sent messages count as taken. None while its host is not found."""
        node = self.nodes[batch[0].receiver]
        if node.at is None or self._transport is None or self._transport.is_closing():
            return None
        refused: dict[int, Refusal] = {}
        for place, message in enumerate(batch):
            if why := self._send(node, message):
                refused[place] = Refusal(code="not_sendable", text=why)
            await asyncio.sleep(PACE)
        return Receipt(taken=len(batch) - len(refused), refused=refused)

    def _send(self, node: Node, message: Message) -> str:
        """Send a message to a node. Returns why it cannot be sent, or an empty text."""
        try:
            payload = write_message(message).encode()
        except (BadDatagram, UnicodeEncodeError) as bad:
            why = f"cannot be written as a datagram: {bad}"
        else:
            if len(payload) <= MAX_DATAGRAM:
                assert self._transport is not None
                self._transport.sendto(payload, node.at)
                self.counters["gateway_out"] += 1
                return ""
            why = f"a datagram of {len(payload)} bytes: Comm nodes read {MAX_DATAGRAM}"
        self._count("unsendable", f"id={message.id} sender={message.sender} receiver={node.name}: {why}")
        return why

    def _report_undelivered(self, message: Message, reason: Refusal) -> None:
        """Send a node the notice that its message is not delivered."""
        node = self.nodes[message.sender]
        log.warning("mail_refused id=%s sender=%s receiver=%s why=%s", message.id, node.name, message.receiver, reason)
        if node.at is not None and self._transport is not None:
            self._send(node, undelivered(message, reason))

    def _refuse(self, source: str, why: str) -> None:
        """Count a datagram that is not from a node of the mission, and log each source once."""
        self.counters["gateway_strangers"] += 1
        if source not in self._strangers and len(self._strangers) < MAX_SOURCES:
            self._strangers.add(source)
            log.warning("refused %s", why[:LONGEST_LOGGED])

    def _count(self, what: str, why: str) -> None:
        counter = f"gateway_{what}"
        self.counters[counter] += 1
        if is_logged(self.counters[counter]):
            log.warning("%s count=%d %s", what, self.counters[counter], why[:LONGEST_LOGGED])

    async def _find_nodes(self) -> None:
        """Look up the hosts of nodes that are not found yet, in the family of our own address."""
        for node in self.nodes.values():
            if node.at is None:
                host, port = host_and_port(node.address)
                try:
                    found = await asyncio.get_running_loop().getaddrinfo(
                        host.strip("[]"), port, family=self._family, type=socket.SOCK_DGRAM
                    )
                except OSError as error:
                    level, node.missed = logging.DEBUG if node.missed else logging.WARNING, True
                    log.log(level, "node %s at %s is not found: %s", node.name, node.address, error)
                else:
                    node.at = (str(found[0][4][0]), port)
                    if node.at[0] in self._hosts:
                        self._hosts[node.at[0]].nodes += 1
                    else:
                        self._hosts[node.at[0]] = Allowance()


def _addressed(message: Message, names: Iterable[str]) -> list[Message]:
    """Return the message, or the copies of a broadcast for everybody but its sender."""
    if message.receiver != EVERYBODY:
        return [message]
    return [replace(message, receiver=name) for name in names if name != message.sender]


@asynccontextmanager
async def open_gateway(mission: Mission, settings: model.Gateway) -> AsyncIterator[Gateway]:
    """Listen to the nodes of the mission's gateway until the end. Raises Findings if it cannot listen."""
    gateway = Gateway(settings.nodes)
    try:
        await gateway.open(settings.listen)
    except OSError as error:
        why = f"gateway.listen: cannot listen at {settings.listen}: {error.strerror or error}"
        raise Findings([mission.positions.finding(("gateway", "listen"), why)]) from None
    log.info("listening to %s for %s", settings.listen, ", ".join(settings.nodes))
    try:
        yield gateway
    finally:
        gateway.close()
