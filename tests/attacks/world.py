"""What the attacks are tried on: three secured boards with routers and mail, and a robot with its bridge on one."""

import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import aclosing, asynccontextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import zenoh

from commd.bus.bus import Bus, open_bus
from commd.bus.session import session_config
from commd.bus.tls import Tls
from schemas.wire import keys
from schemas.wire.records import Health, Mail, Mailboxes, Message, Perception, Record
from tests.soak.report import Judged
from tests.support.buses import until
from tests.support.processes import Daemon
from tests.support.secured import FLEET, Secured

NAME = "three"
TEXT = FLEET.replace("prefix: r1}", "prefix: r1, simulate: {vehicle: turtle}}").replace(
    "[eye]", "{eye: telemetry, mate: minds, judge: mail}"
)
R = TypeVar("R", bound=Record)


@dataclass
class Row(Judged):
    """One attack: it was refused, can be seen, and what is allowed was not refused."""

    attack: str
    tried: str
    """How, by whom."""
    refused: str
    """By whom, and how."""


class World:
    """The fleet, and the ways of attackers and of those who may."""

    def __init__(self, fleet: Secured) -> None:
        self.fleet = fleet
        self.commd: dict[str, Daemon] = {}
        self.bridged: Daemon

    def begin(self) -> None:
        """Start the daemons and wait until they serve."""
        fleet = self.fleet
        self.commd = {board: fleet.start(board, "commd") for board in fleet.ports}
        for daemon in self.commd.values():
            daemon.says("router board=")
        simulator = fleet.run("argosy", "simulate", str(fleet.path), "--board", "pi1", "--router", fleet.socket("pi1"))
        simulator.says("simulated turtle")
        self.bridged = fleet.start("pi1", "bridged")
        self.bridged.says("serving r1")

    @asynccontextmanager
    async def member(self, board: str, name: str = "x") -> AsyncIterator[Bus]:
        """A daemon on a board."""
        async with open_bus(self.fleet.socket(board), fleet=NAME, name=name, daemon="agentd", patience=5) as bus:
            yield bus

    @asynccontextmanager
    async def machine(self, name: str, at: str, tls: Tls | None = None, patience: float = 5) -> AsyncIterator[Bus]:
        """A machine that shows the keys of `name` to the router of a board."""
        tls = tls or self.fleet.tls(name)
        async with open_bus(
            self.fleet.link(at), fleet=NAME, name=name, daemon="attack", tls=tls, patience=patience
        ) as bus:
            yield bus


Attack: TypeAlias = Callable[[World], Awaitable[Row]]


def attack(name: str, tried: str, refused: str) -> Callable[[Callable[[Row, World], Awaitable[None]]], Attack]:
    """Make an attack of what notes in its row what came of it."""

    def decorate(body: Callable[[Row, World], Awaitable[None]]) -> Attack:
        async def make(world: World) -> Row:
            row = Row(name, tried, refused)
            await body(row, world)
            return row

        make.__name__, make.__doc__ = body.__name__, body.__doc__
        return make

    return decorate


def letter(sender: str, receiver: str, number: int = 1, content: Any = 1) -> Mail:
    one = Message(
        id=f"{sender}.{time.time_ns()}.{receiver}.{number}",
        sender=sender,
        performative="tell",
        receiver=receiver,
        content=content,
    )
    return Mail(messages=(one,))


async def ask(bus: Bus, key: str, record: Record | None, answer: type[R], seconds: float = 5) -> list[R | str]:
    """Ask once: records, and words of refusal."""
    async with aclosing(bus.query(key, record, answer, seconds)) as replies:
        return [reply.record if reply.record is not None else reply.error async for reply in replies]


async def waiting_for(bus: Bus, receiver: str, sender: str) -> int:
    """Messages from a sender that wait for a receiver on any board that answers."""
    found = await ask(bus, keys.mailboxes(NAME, "*"), None, Mailboxes)
    queues = [queue for boxes in found if isinstance(boxes, Mailboxes) for queue in boxes.queues]
    return sum(queue.messages for queue in queues if (queue.receiver, queue.sender) == (receiver, sender))


async def health_of(bus: Bus, name: str, daemon: str) -> Health:
    """The next health record of a daemon."""
    found: list[Health] = []
    bus.subscribe(keys.health(NAME, name, daemon), Health, lambda _, record: found.append(record))
    await until(lambda: bool(found), f"health of {daemon} {name}")
    return found[-1]


def raw_session(endpoint: str, tls: Tls | None) -> zenoh.Session:
    """A session of Zenoh's own, for what the bus would not send. Raises ZError."""
    return zenoh.open(session_config("client", endpoint, "attack", tls=tls))


async def put_until(attacker: Bus, heard: list[str], forged: str, own: str) -> None:
    """Put what is forged and then what is allowed, until the latter has arrived twice: the former had its time."""
    record = Perception(name="x", header=attacker.header("x"))

    def twice() -> bool:
        attacker.put(forged, record)
        attacker.put(own, record)
        return heard.count(own) >= 2

    await until(twice, f"{own} arrives")
