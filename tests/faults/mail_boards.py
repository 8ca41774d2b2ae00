"""Boards whose mail is put to the test: real `commd` processes on one machine, and programs that post and read."""

import asyncio
import re
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

from commd.bus.bus import Bus, open_bus
from commd.client import Client, join
from schemas.wire import keys
from schemas.wire.records import Health, Mailboxes
from tests.faults.real import resident
from tests.faults.rows import Maker, Row
from tests.support.buses import until
from tests.support.ports import free_port
from tests.support.processes import Daemon

FLEET = "office"
PATIENCE = 180.0
"""Seconds for a whole row."""
GROWTH = 15.0
"""MB that a commd may grow by what is done to it."""
MISSION = """\
mission: office
boards: {pi1: {}, pi2: {}}
agents: {uav: {program: uav.asl, board: pi1}}
clients: {ann: {board: pi1}, bob: {board: pi2}, cid: {board: pi1}}
"""


class MailBoards:
    """The boards pi1 and pi2; ann and cid live on pi1, bob on pi2."""

    def __init__(self, folder: Path, stack: AsyncExitStack, mission: str = MISSION) -> None:
        self.folder, self._stack = folder, stack
        self.mission = folder / "boards.yaml"
        self.mission.write_text(mission)
        self.endpoints = {board: f"tcp/127.0.0.1:{free_port()}" for board in ("pi1", "pi2")}
        self._between = f"tcp/127.0.0.1:{free_port()}"
        self.daemons: dict[str, Daemon] = {}
        self.health: dict[str, Health] = {}
        """The last words of each commd about itself."""

    def command(self, board: str) -> tuple[str, ...]:
        """Return the arguments of a board's commd."""
        way = "--listen" if board == "pi1" else "--connect"
        state = str(self.folder / "state" / board)
        return (
            *("commd", "serve", str(self.mission), "--board", board, "--state", state),
            *("--router", self.endpoints[board], way, self._between),
        )

    async def start(self, board: str, *instead: str) -> Daemon:
        """Start a commd, by `python -m INSTEAD` if that is said, and wait until it serves."""
        daemon = Daemon(*(instead or self.command(board)))
        self._stack.callback(daemon.kill)
        self.daemons[board] = daemon
        await asyncio.to_thread(daemon.says, "router board=", 60)
        return daemon

    def file(self, board: str) -> Path:
        """Return the file of a board's mail."""
        return self.folder / "state" / board / FLEET / f"{board}.mail"

    @asynccontextmanager
    async def program(self, name: str, board: str = "") -> AsyncIterator[Client]:
        """A program as a member of the team, at its board's router."""
        home = board or ("pi2" if name == "bob" else "pi1")
        async with join(name, mission=self.mission, router=self.endpoints[home], patience=30) as client:
            yield client

    @asynccontextmanager
    async def bus(self, board: str = "pi1") -> AsyncIterator[Bus]:
        """A session of nobody in particular, which notes the health of all commd."""
        async with open_bus(self.endpoints[board], fleet=FLEET, name="test", daemon="test", patience=30) as bus:
            bus.subscribe(keys.health(FLEET, "*", "commd"), Health, self._note)
            yield bus

    def _note(self, key: str, health: Health) -> None:
        self.health[key.split("/")[2]] = health

    async def reported(self, board: str, condition: Callable[[Health], bool], wish: str) -> Health:
        """Wait until the health of a commd shows something."""
        await until(lambda: board in self.health and condition(self.health[board]), wish, 20)
        return self.health[board]


async def boxes(bus: Bus, board: str) -> Mailboxes | None:
    """Return what waits at a board; None if nobody answers, as the board is not connected yet."""
    async for reply in bus.query(keys.mailboxes(FLEET, board), None, Mailboxes, 10):
        if reply.record is not None:
            return reply.record
    return None


async def waits(bus: Bus, board: str, messages: int) -> Mailboxes:
    """Wait until so many messages wait at a board. Returns what does."""
    found: list[Mailboxes] = []

    async def all_wait() -> bool:
        found.extend(filter(None, [await boxes(bus, board)]))
        return bool(found) and sum(queue.messages for queue in found[-1].queues) == messages

    await until(all_wait, f"{messages} messages wait at {board}", 30)
    return found[-1]


async def read(client: Client, count: int, seconds: float = 60, quiet: float = 1.0) -> list[Any]:
    """Return the contents of the next messages: so many, and whatever comes in the moment after them."""
    found: list[Any] = []
    reading = client.messages()
    while True:
        try:
            wait = seconds if len(found) < count else quiet
            message = await asyncio.wait_for(anext(reading), wait)
        except TimeoutError:
            return found
        found.append(message.content)
        client.done(message)


def expect_all(row: Row, found: list[Any], wanted: list[Any]) -> None:
    """Note how many messages came, and expect each once and in order."""
    row.expect(found == wanted, f"each of {len(wanted)} messages once and in order; got {len(found)}: {found[:5]}...")
    if found == wanted:
        row.seen.append(f"{len(found)} of {len(wanted)} messages, each once and in order")


def grown(row: Row, daemon: Daemon, before: float) -> None:
    """Note what a daemon's memory has grown by."""
    growth = resident(daemon) - before
    row.bound = f"commd +{growth:.1f} MB"
    row.expect(growth < GROWTH, f"commd grows by less than {GROWTH:g} MB, not {growth:.1f}")


def held(daemon: Daemon) -> None:
    """Expect that a daemon lives, and has told of no defect."""
    assert daemon.process.poll() is None, f"it ended: {daemon.text}"
    assert not re.search("Traceback|defect|panicked", daemon.text), daemon.text


def row_of(body: Callable[[MailBoards], Coroutine[Any, Any, None]], folder: Path, mission: str = MISSION) -> None:
    """Run a row with an office that ends with it."""

    async def run() -> None:
        async with asyncio.timeout(PATIENCE), AsyncExitStack() as stack:
            await body(MailBoards(folder, stack, mission))

    asyncio.run(run())


def on_mail_boards(
    fault: str, injected: str
) -> Callable[[Callable[[Row, MailBoards], Coroutine[Any, Any, None]]], Maker]:
    """Make a row of what is done in an office of its own."""

    def decorate(body: Callable[[Row, MailBoards], Coroutine[Any, Any, None]]) -> Maker:
        def make(state: Path) -> Row:
            row = Row(fault, injected)
            row_of(lambda boards: body(row, boards), state)
            return row

        make.__name__, make.__doc__ = body.__name__, body.__doc__
        return make

    return decorate
