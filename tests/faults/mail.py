"""The faults that come to mail from outside: broken input, another version, clocks that jump."""

import asyncio
import random
import socket
from pathlib import Path

import zenoh

from commd.bus.bus import Bus
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import Mail, Message, Receipt
from tests.faults.mail_boards import (
    FLEET,
    MISSION,
    MailBoards,
    expect_all,
    grown,
    held,
    on_mail_boards,
    read,
    row_of,
    waits,
)
from tests.faults.real import resident
from tests.faults.rows import Maker, Row
from tests.support.buses import until
from tests.support.ports import free_port
from tests.support.processes import Daemon

DATAGRAMS, RECORDS = 2_000, 600
"""Malformed ones, each."""
RATE = 150.0
"""Datagrams a second, below what a gateway takes of one node."""
YEAR = 365 * 86_400.0
_SHIFTED = """\
import runpy, sys, time
now, now_ns = time.time, time.time_ns
time.time = lambda: now() + {shift}
time.time_ns = lambda: now_ns() + int({shift} * 1e9)
sys.argv = {arguments!r}
runpy.run_module({module!r}, run_name="__main__")
"""


def datagrams(state: Path) -> Row:
    """Noise, torn and forged datagrams come to the gateway, with good ones among them."""
    listen, node = free_port(), free_port()
    gateway = f'gateway: {{board: pi1, listen: "127.0.0.1:{listen}", nodes: {{old: "127.0.0.1:{node}"}}}}\n'
    row = Row(
        "malformed datagrams", f"real UDP: {DATAGRAMS} at the gateway, {RATE:g} a second, a good one after each 20"
    )

    async def body(boards: MailBoards) -> None:
        daemon = await boards.start("pi1")
        before, chance = resident(daemon), random.Random(5)
        async with boards.bus() as bus, boards.program("ann") as ann:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as old:
                old.bind(("127.0.0.1", node))
                for number in range(DATAGRAMS):
                    old.sendto(_malformed(chance), ("127.0.0.1", listen))
                    if number % 20 == 0:
                        await asyncio.sleep(20 / RATE)
                        old.sendto(f"<o{number},old,tell,ann,{number}>".encode(), ("127.0.0.1", listen))
                expect_all(row, await read(ann, DATAGRAMS // 20), list(range(0, DATAGRAMS, 20)))
            health = await boards.reported("pi1", lambda it: it.bad_input > DATAGRAMS * 0.9, "they are counted")
            row.seen.append(f"{health.bad_input} counted as bad input, {health.drops} dropped unread")
            assert bus.router_up
        held(daemon)
        grown(row, daemon, before)

    row_of(body, state, MISSION + gateway)
    return row


def _malformed(chance: random.Random) -> bytes:
    """A datagram that is no message."""
    good = b'<m1,old,tell,ann,item(1,"a",[2,3])>'
    match chance.randrange(5):
        case 0:
            return chance.randbytes(chance.randrange(1, 1400))
        case 1:
            return good[: chance.randrange(1, len(good) - 1)]
        case 2:
            return b"<" + b"," * chance.randrange(1, 300) + b">"
        case 3:
            return b"<m1,old,tell,ann,f(" + b"(" * chance.randrange(1, 900) + b">"
        case _:
            return b"<m1,o<d,te>l,ann,\xff\xfe" + chance.randbytes(9) + b">"


@on_mail_boards(
    "malformed mail records", f"real Zenoh: {RECORDS} queries with broken payloads on outbox, mail and inbox keys"
)
async def records(row: Row, boards: MailBoards) -> None:
    """Payloads that are no mail come on every key of the mail, with good ones among them."""
    for board in ("pi1", "pi2"):
        await boards.start(board)
    daemon = boards.daemons["pi1"]
    before, chance = resident(daemon), random.Random(7)
    async with boards.bus() as bus, boards.program("ann") as ann, boards.program("bob") as bob:
        refused = 0
        targets = [keys.outbox(FLEET, "ann"), keys.mail(FLEET, "ann", "bob"), keys.inbox(FLEET, "bob")]
        for key in targets:
            await _answered(bus, key)
        for number in range(RECORDS):
            errors = await _ask(bus, targets[number % 3], _broken(chance))
            refused += any(errors)
            if number % 30 == 0:
                await ann.send("bob", "tell", number)
        expect_all(row, await read(bob, RECORDS // 30), list(range(0, RECORDS, 30)))
        row.expect(refused == RECORDS, f"each is answered with an error, {refused} of {RECORDS} were")
        row.seen.append(f"{refused} answered with an error")
    held(daemon)
    grown(row, daemon, before)


def _broken(chance: random.Random) -> tuple[bytes, str]:
    """A payload that is no Mail record, and its encoding."""
    good = codec(Mail).encode(
        Mail(messages=(Message(id="x", sender="ann", performative="tell", receiver="bob", content=1),))
    )
    match chance.randrange(4):
        case 0:
            return chance.randbytes(chance.randrange(1, 3000)), codec(Mail).encodings["json"]
        case 1:
            return good[: chance.randrange(1, len(good) - 1)], codec(Mail).encodings["json"]
        case 2:
            return b"[" * 5000, ""
        case _:
            return good.replace(b'"receiver"', b'"reciever"'), "application/json"


async def _ask(bus: Bus, key: str, sent: tuple[bytes, str]) -> list[str]:
    """Ask a key with raw bytes; return the errors that came back."""
    payload, encoding = sent

    def ask() -> list[str]:
        found = []
        for reply in bus._session.get(key, payload=payload, encoding=encoding or None, timeout=10.0):
            found.append(reply.err.payload.to_bytes().decode() if reply.err is not None else "")
        return found

    return await asyncio.to_thread(ask)


async def _answered(bus: Bus, key: str) -> None:
    """Wait until mail without messages is answered. Zenoh matches a key of another board up to 0.1 s before its router
    has a route to it (it computes them at most so often), and until then a query ends without an answer."""
    mail = codec(Mail)
    empty = mail.encode(Mail(), "json"), mail.encodings["json"]

    async def answered() -> bool:
        return await _ask(bus, key, empty) == [""]

    await until(answered, f"{key} is answered")


@on_mail_boards(
    "a peer with another schema version",
    "real Zenoh: it asks with Mail of version 2, and answers ann's mail to bob with receipts of version 2",
)
async def other_version(row: Row, boards: MailBoards) -> None:
    """A board with another major version of the records stands where bob's should be, until the right one comes."""
    daemon = await boards.start("pi1")
    foreign = codec(Mail).encodings["json"].replace("/1", "/2")
    receipts = codec(Receipt).encodings["json"].replace("/1", "/2")
    row.expect("/2" in foreign and "/2" in receipts, "the encoding carries a version")
    async with boards.bus() as bus, boards.program("ann") as ann:
        errors = await _ask(bus, keys.outbox(FLEET, "ann"), (b'{"messages":[]}', foreign))
        row.expect(errors and "version" in errors[0], f"the answer names the version, it is {errors}")
        row.seen.append(f"its question is answered: `{errors[0]}`" if errors else "no answer")
        asked: list[int] = []

        def answer(query: zenoh.Query) -> None:
            with query:
                asked.append(1)
                query.reply(str(query.key_expr), b'{"taken":20}', encoding=receipts)

        queryable = bus._session.declare_queryable(keys.mail(FLEET, "bob", "*"), answer)
        token = bus.token(keys.alive(FLEET, "pi2", "commd", "foreign"))
        for number in range(20):
            await ann.send("bob", "tell", number)
        await until(lambda: len(asked) > 1, "its mail is offered, and offered again")
        kept = await waits(bus, "pi1", 20)
        row.seen.append(f"its receipts are not believed: 20 messages wait, `{kept.queues[0].state}`")
        queryable.undeclare()  # type: ignore[no-untyped-call]
        bus.withdraw(token)
        await boards.start("pi2")
        async with boards.program("bob") as bob:
            expect_all(row, await read(bob, 20), list(range(20)))
    held(daemon)
    row.bound = "-"


@on_mail_boards(
    "clock jumps", "real processes: `time.time` of pi2's commd is a year behind, then, after kill -9, a year ahead"
)
async def clock_jumps(row: Row, boards: MailBoards) -> None:
    """The wall clocks of a board's daemon are a year behind, and in its next life a year ahead."""
    await boards.start("pi1")
    command = boards.command("pi2")

    async def shifted(shift: float) -> Daemon:
        script = boards.folder / "shifted.py"
        script.write_text(_SHIFTED.format(shift=shift, arguments=list(command), module=command[0]))
        return await boards.start("pi2", "tests.faults.script", str(script))

    await shifted(-YEAR)
    async with boards.program("ann") as ann:
        for number in range(10):
            await ann.send("bob", "tell", number, ttl=60.0)
        async with boards.bus() as bus:
            await waits(bus, "pi2", 10)
        boards.daemons["pi2"].kill()
        for number in range(10, 20):
            await ann.send("bob", "tell", number, ttl=60.0)
        late = await shifted(+YEAR)
        async with boards.bus() as bus:
            await waits(bus, "pi2", 20)
        await ann.send("bob", "tell", "too late", ttl=0.5)
        await asyncio.sleep(1.5)
        async with boards.program("bob") as bob:
            expect_all(row, await read(bob, 20), list(range(20)))
        reported = await read(ann, 1)
        row.expect(
            len(reported) == 1 and "expired" in str(reported[0]), f"what lived for 0.5 s is given up, told {reported}"
        )
        row.seen.append(
            "`ttl` of 60 s outlived both jumps; one of 0.5 s ended after 0.5 s, and its sender was notified"
        )
    held(late)
    row.bound = "-"


MAIL_INPUT: tuple[Maker, ...] = (datagrams, records, other_version, clock_jumps)
