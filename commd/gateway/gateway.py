"""The gateway to Comm nodes of the paper (section 4.4): UDP datagrams `<id,sender,itlforce,receiver,data>`, both ways.

UDP promises nothing, and old nodes acknowledge nothing: what was sent counts as delivered. What a node sends is taken
into the mail as soon as it is on disk. Datagrams are untrusted: each is counted and told, none ends anything.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager

from msgspec.structs import replace

from commd.gateway.paper_node import RATE, Allowance, BadDatagram, Node, read_message, write_message
from commd.mail.message import undelivered
from commd.mail.service import MailService
from commd.mail.store import StoreFailed
from schemas.files.findings import Findings
from schemas.files.units import host_and_port
from schemas.mission import model
from schemas.mission.model import Mission
from schemas.wire.records import Health, Message, Receipt, Refusal

log = logging.getLogger("gateway")

MAX_DATAGRAM = 1024
"""Bytes that an old Comm node reads of a datagram; the rest it would cut off."""
MAX_HEARD = 4096
"""Bytes of a datagram that are looked at; nodes that keep to what their peers read send no longer ones."""
EVERYBODY = "null"
"""The receiver of a broadcast: Jason writes none as this."""
QUEUE = 1000
"""Datagrams that may wait to be taken into the mail; further ones are dropped and counted."""
BATCH = 64
PACE = 0.002
"""Seconds between two datagrams to one node: old nodes read one at a time and lose what does not fit their buffer."""
DISK_RETRY = 1.0
"""Seconds between two attempts while the disk takes nothing."""
SEEK_EVERY = 10.0
"""Seconds between two looks for a node whose host has no address yet."""
TOLD_SOURCES = 1000
LONGEST_LOGGED = 200
"""Characters of what a stranger sent that are logged."""


class Gateway(asyncio.DatagramProtocol):
    """Speaks to the nodes of the mission, or to none. Make it with `open_gateway`."""

    def __init__(self, nodes: Mapping[str, str], now: Callable[[], float] = time.monotonic) -> None:
        self.nodes = {name: Node(name, address) for name, address in nodes.items()}
        self.work: list[asyncio.Task[None]] = []
        """What goes on for ever, while it serves: whoever opens it watches it."""
        self.counters: Counter[str] = Counter()
        """gateway_in, gateway_out, gateway_malformed, gateway_strangers, gateway_repeated, gateway_dropped,
        gateway_refused, gateway_unsendable, gateway_errors: datagrams so far."""
        self._now = now
        self._hosts: dict[str, Allowance] = {}
        """The hosts that are heard."""
        self._waiting: asyncio.Queue[Message] = asyncio.Queue(QUEUE)
        self._strangers: set[str] = set()
        self._transport: asyncio.DatagramTransport | None = None
        self._family = socket.AF_UNSPEC

    async def open(self, listen: str) -> None:
        """Look for the nodes' hosts and begin to listen. Raises OSError when the address is not to be had."""
        host, port = host_and_port(listen)
        loop = asyncio.get_running_loop()
        ours = await loop.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_DGRAM)
        self._family = ours[0][0]
        await self._find_nodes()
        self._transport, _ = await loop.create_datagram_endpoint(
            lambda: self, local_addr=(host.strip("[]"), port), family=self._family
        )

    @asynccontextmanager
    async def serving(self, mail_service: MailService) -> AsyncIterator[None]:
        """Carry mail between the nodes and `mail_service` while the block runs."""
        detach = [mail_service.attach(name, self.deliver) for name in self.nodes]
        running = self.work = [asyncio.create_task(self._take(mail_service)), asyncio.create_task(self._seek())]
        try:
            yield
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)
            for end in detach:
                end()

    def health(self) -> Health:
        """Return what became of the datagrams, for the daemon's health."""
        counters = {name: float(count) for name, count in sorted(self.counters.items())}
        dropped, bad = self.counters["gateway_dropped"], self.counters["gateway_malformed"]
        return Health(counters=counters, drops=dropped, bad_input=bad)

    def close(self) -> None:
        """Speak and hear no more."""
        if self._transport is not None:
            self._transport.close()

    def error_received(self, exc: Exception) -> None:
        """The system could not send an earlier datagram."""
        self.counters["gateway_errors"] += 1
        log.debug("not_sent why=%s", exc)

    def datagram_received(self, data: bytes, addr: tuple[str, int] | tuple[str, int, int, int]) -> None:
        """Queue what a node says."""
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
            why = "it is no node of the mission" if node is None else f"its node is at {node.address}"
            self._refuse(f"{message.sender} {host}", f"sender={message.sender} from {host}: {why}")
        elif self._waiting.full():
            self._count("dropped", f"sender={node.name}: {QUEUE} datagrams wait")
        elif node.repeats(data, now):
            self.counters["gateway_repeated"] += 1
        else:
            self._waiting.put_nowait(message)

    async def _seek(self) -> None:
        """Look for nodes that are not found yet, for ever."""
        while True:
            await asyncio.sleep(SEEK_EVERY)
            await self._find_nodes()

    async def _take(self, mail_service: MailService) -> None:
        """Take what the nodes said into the mail, for ever."""
        while True:
            said = [await self._waiting.get()]
            while len(said) < BATCH and not self._waiting.empty():
                said.append(self._waiting.get_nowait())
            batch = [one for message in said for one in _addressed(message, mail_service.names)]
            receipt = await self._hand_over(batch, mail_service)
            for place, reason in (receipt.refused | receipt.later).items():
                self.counters["gateway_refused"] += 1
                self._tell_undelivered(batch[place], reason)

    async def _hand_over(self, batch: list[Message], mail_service: MailService) -> Receipt:
        """Give a batch to the mail, again and again while its disk takes nothing: what comes meanwhile waits."""
        while True:
            try:
                return await mail_service.take(batch)
            except StoreFailed as failed:
                log.debug("not_taken messages=%d why=%s", len(batch), failed)
            except Exception as error:  # one batch's defect must not end what all others live by
                log.exception("defect in argosy: %d messages of nodes are lost", len(batch))
                defect = Refusal(code="defect", text=f"{type(error).__name__}: {error}")
                return Receipt(refused=dict.fromkeys(range(len(batch)), defect))
            await asyncio.sleep(DISK_RETRY)

    async def deliver(self, batch: tuple[Message, ...]) -> Receipt | None:
        """Send a batch to the node of its receiver; what has left counts as taken. None while its host is not found."""
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

    def _tell_undelivered(self, message: Message, reason: Refusal) -> None:
        """Tell a node, as agents are told, that its message will not arrive."""
        node = self.nodes[message.sender]
        log.warning("mail_refused id=%s sender=%s receiver=%s why=%s", message.id, node.name, message.receiver, reason)
        if node.at is not None and self._transport is not None:
            self._send(node, undelivered(message, reason))

    def _refuse(self, source: str, why: str) -> None:
        """Count what does not come from a node of the mission, and tell once of each source."""
        self.counters["gateway_strangers"] += 1
        if source not in self._strangers and len(self._strangers) < TOLD_SOURCES:
            self._strangers.add(source)
            log.warning("refused %s", why[:LONGEST_LOGGED])

    def _count(self, what: str, why: str) -> None:
        counter = f"gateway_{what}"
        self.counters[counter] += 1
        if self.counters[counter] <= 10 or self.counters[counter] % 1000 == 0:
            log.warning("%s count=%d %s", what, self.counters[counter], why[:LONGEST_LOGGED])

    async def _find_nodes(self) -> None:
        """Look for the hosts of those nodes whose host is not found yet, in the family of our own address."""
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
    """A message, or the copies of a broadcast: for everybody but its sender."""
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
