"""The faults of the files in which mail and minds are kept: corrupt, of a newer version, on a full disk."""

import asyncio
import random
import shutil
import sqlite3
from contextlib import ExitStack
from pathlib import Path

from commd.bus.bus import Bus, open_bus
from commd.client import SendTimeout
from commd.mail.age_clock import WENT_BACK
from schemas.wire import keys
from schemas.wire.health import each_health
from schemas.wire.records import BoardServices, Health, MailSeen
from tests.boards.disk import Disk
from tests.faults.mail_boards import FLEET, MailBoards, expect_all, grown, held, on_mail_boards, read, row_of, waits
from tests.faults.real import resident
from tests.faults.rows import Maker, Row
from tests.support.buses import until
from tests.support.ports import free_port
from tests.support.processes import running

_TEAM = """\
mission: office
agents:
  ann: {program: agent.asl}
  bob: {program: agent.asl}
"""
_AGENT = """\
!begin.
+!begin <- +lives(1); .print("begun").
+restarted(N) <- ?lives(L); -+lives(L + 1); .print("restarted ", N, ", lives ", L + 1).
"""


@on_mail_boards("corrupt database of commd", "real file: noise over its pages after kill -9, then restart")
async def corrupt_mail(row: Row, boards: MailBoards) -> None:
    """A board's mail file is overwritten with noise while its commd is dead."""
    for board in ("pi1", "pi2"):
        await boards.start(board)
    async with boards.bus("pi2") as bus, boards.program("ann") as ann, boards.program("bob") as bob:
        for number in range(5):
            await ann.send("cid", "tell", number)  # these wait at pi1, where the file will be lost
            await bob.send("cid", "tell", number)
        await waits(bus, "pi1", 10)
        await asyncio.to_thread(boards.daemons["pi1"].kill)
        for number in range(5, 10):
            await bob.send("cid", "tell", number)  # these wait at pi2
        _noise(boards.file("pi1"))
        daemon = await boards.start("pi1")
        aside = sorted(one.name for one in boards.file("pi1").parent.glob("*.corrupt-1"))
        row.expect(aside == ["pi1.mail.corrupt-1"], f"the file is set aside, found {aside}")
        row.expect("database_corrupt" in daemon.text, "the log tells of it")
        health = await boards.reported(
            "pi1", lambda it: it.notes[:1] and it.notes[0].code == "mail_file_set_aside", "a note"
        )
        row.seen.append(f"set aside, and reported: `{health.notes[0].text}`")
        async with boards.program("cid") as cid:
            expect_all(row, await read(cid, 5), list(range(5, 10)))
            await ann.send("cid", "tell", "after")
            row.expect(await read(cid, 1) == ["after"], "mail goes on")
        row.seen.append("the other board's mail and what came after is delivered")
    held(daemon)
    row.bound = "-"


def _keep(endpoint: str) -> None:
    """Wait until ann and bob have been saved."""

    async def body() -> None:
        saved = set[str]()

        def heard(key: str, health: Health) -> None:
            saved.update(name for name, its in each_health(key, health) if its.counters.get("kept_saved"))

        async with open_bus(endpoint, fleet=FLEET, name="observer", daemon="test") as bus:
            bus.subscribe(keys.health(FLEET, "*", "agentd"), Health, heard)
            await until(lambda: len(saved) == 2, "both minds are on disk")

    asyncio.run(body())


def _noise(path: Path) -> None:
    """Overwrite a database, its beginning aside, and what belongs to it."""
    chance = random.Random(3)
    for one in (path, path.with_name(path.name + "-wal")):
        if one.exists():
            data = bytearray(one.read_bytes())
            data[100:] = chance.randbytes(max(0, len(data) - 100))
            one.write_bytes(bytes(data))


@on_mail_boards("mail file that goes back in time", "real files: a copy of the board's folder put back after kill -9")
async def mail_restored(row: Row, boards: MailBoards) -> None:
    """A board's folder is put back to a copy of before it has taken and sent more mail."""
    folder, copy = boards.file("pi1").parent, boards.folder / "copy"
    for board in ("pi1", "pi2"):
        await boards.start(board)
    async with boards.bus("pi2") as bus, boards.program("ann") as ann, boards.program("bob") as bob:
        for number in range(3):
            await ann.send("bob", "tell", number)
        expect_all(row, await read(bob, 3), [0, 1, 2])
        await ann.send("cid", "tell", "before")
        await asyncio.to_thread(boards.daemons["pi1"].kill)
        shutil.copytree(folder, copy)
        await boards.start("pi1")
        await _seen(bus, "pi1")
        for number in range(3, 6):
            await ann.send("bob", "tell", number)
        expect_all(row, await read(bob, 3), [3, 4, 5])
        await ann.send("cid", "tell", "after")
        await asyncio.to_thread(boards.daemons["pi1"].kill)
        shutil.rmtree(folder)
        shutil.copytree(copy, folder)
        daemon = await boards.start("pi1")
        health = await boards.reported("pi1", lambda it: [note.code for note in it.notes] == [WENT_BACK], "a note")
        row.seen.append(f"reported in health, code `{WENT_BACK}`: `{health.notes[0].text}`")
        row.expect(f"event={WENT_BACK} board=pi1 " in daemon.text, "the log tells of it")
        for number in range(6, 8):
            await ann.send("bob", "tell", number)
        expect_all(row, await read(bob, 2), [6, 7])
        async with boards.program("cid") as cid:
            found = await read(cid, 1)
            row.expect(found == ["before"], f"what the copy holds is delivered, got {found}")
        row.seen.append("mail for cid: 1 of before the copy arrives, 1 of after it is lost")
        await asyncio.to_thread(daemon.kill)
        daemon = await boards.start("pi1")
        await _seen(bus, "pi1")
        row.expect(f"event={WENT_BACK}" not in daemon.text, "the next life does not tell it again")
    held(daemon)
    row.bound = "-"


async def _seen(bus: Bus, board: str) -> None:
    """Wait until pi2 has seen the mail file of a board in its present life."""

    async def seen() -> bool:
        boots = {token.rpartition("/")[2] for token in await bus.tokens(keys.alive(FLEET, board, "commd", "*"))}
        async for reply in bus.query(keys.services(FLEET, "pi2"), None, BoardServices, 5):
            printed = reply.record
            if (
                printed is not None
                and printed.board == "pi2"
                and {printed.mail_seen.get(board, MailSeen()).boot} == boots
            ):
                return True
        return False

    await until(seen, f"pi2 sees the mail file of {board}", 60)


def corrupt_checkpoint(state: Path) -> Row:
    """The checkpoint of an agentd with two agents is overwritten with noise while it is dead."""
    row = Row("corrupt checkpoint", "real file: noise over its pages after kill -9, then restart")
    mission, endpoint = _team(state), f"tcp/127.0.0.1:{free_port()}"
    agentd = ("agentd", "serve", mission, "--router", endpoint, "--state", str(state / "minds"))
    with running("commd", "serve", mission, "--router", endpoint, "--state", str(state / "mail")):
        with running(*agentd) as first:
            first.until(lambda text: text.count("begun") == 2, "both have begun")
            _keep(endpoint)
        file = next((state / "minds").rglob("*.minds"))
        _noise(file)
        with running(*agentd) as second:
            second.until(lambda text: text.count("begun") == 2, "both begin")
            aside = [one.name for one in (state / "minds").rglob("*.corrupt-1")]
            row.expect(aside == [f"{file.name}.corrupt-1"], f"the file is set aside, found {aside}")
            noted = [line for line in second.lines if "database_corrupt" in line]
            row.expect(noted, "the log tells of it")
            row.seen.append(
                f"set aside, and reported: `{noted[0][noted[0].index(str(state)) :].replace(str(state), 'DIR')}`"
                if noted
                else "not told"
            )
            row.seen.append("its agents start without a state")
    row.bound = "-"
    return row


def newer_version(state: Path) -> Row:
    """The databases were written by a newer Argosy."""
    row = Row("databases of a newer version", "real files: `PRAGMA user_version = 99` in both, then restart")
    mission, endpoint = _team(state), f"tcp/127.0.0.1:{free_port()}"
    commd = ("commd", "serve", mission, "--router", endpoint, "--state", str(state / "mail"))
    agentd = ("agentd", "serve", mission, "--router", endpoint, "--state", str(state / "minds"))
    with running(*commd) as first, running(*agentd) as mind:
        mind.until(lambda text: text.count("begun") == 2, "both have begun")
        _keep(endpoint)
        first.says("router board=")
    files = [next((state / "mail").rglob("*.mail")), next((state / "minds").rglob("*.minds"))]
    for path, command in zip(files, (commd, agentd), strict=True):
        with sqlite3.connect(path) as db:
            db.execute("PRAGMA user_version = 99")
        db.close()
        before = path.read_bytes()
        with ExitStack() as stack:
            if command is agentd:  # which is told by its file, not by a router that it does not find
                router = stack.enter_context(running(*commd[:-1], str(state / "other")))
                router.says("router board=")
            refused = stack.enter_context(running(*command))
            code = refused.ends(30)
        printed = next((line for line in refused.lines if "99" in line), "")
        row.expect(code in (1, 2) and printed, f"{command[0]} ends and says why: exit {code}, {refused.lines[-3:]}")
        row.expect(path.read_bytes() == before, f"{path.name} is left alone")
        row.seen.append(f"{command[0]} does not start: `{printed.partition(': ')[2].replace(str(path), path.name)}`")
    row.seen.append("the files are left alone")
    row.bound = "-"
    return row


def full_disk(state: Path) -> Row:
    """The disk that holds a board's mail has no byte left for a while."""
    row = Row("full disk", "real file system (tmpfs) filled to its last byte while programs send")

    async def body(boards: MailBoards) -> None:
        for board in ("pi1", "pi2"):
            await boards.start(board)
        daemon = boards.daemons["pi1"]
        before = resident(daemon)
        async with boards.bus() as bus, boards.program("ann") as ann, boards.program("bob") as bob:
            for number in range(10):
                await ann.send("bob", "tell", number)
            disk.fill()
            failed: SendTimeout | None = None
            number = 10
            while failed is None and number < 5_000:  # the file's own spare room takes some
                try:
                    await ann.send("bob", "tell", number, patience=3.0)
                    number += 1
                except SendTimeout as error:
                    failed = error
            assert failed is not None
            row.seen.append(f"with the disk full, `send` fails after {number - 10} more: nothing is acknowledged")
            health = await boards.reported("pi1", lambda it: bool(it.notes), "a note in the health record")
            row.seen.append(f"reported: `{health.notes[0].text.replace(str(state), 'DIR')}`")
            disk.free()
            await ann.send_again(failed)
            for after in range(number + 1, number + 11):
                await ann.send("bob", "tell", after)
            expect_all(row, await read(bob, number + 11, quiet=2.0), list(range(number + 11)))
            assert bus.router_up
        held(daemon)
        grown(row, daemon, before)

    with Disk(state / "state" / "pi1", 8) as disk:
        row_of(body, state)
    return row


def _team(folder: Path) -> str:
    (folder / "agent.asl").write_text(_AGENT)
    (folder / "boards.yaml").write_text(_TEAM)
    return str(folder / "boards.yaml")


MAIL_FILES: tuple[Maker, ...] = (corrupt_mail, mail_restored, corrupt_checkpoint, newer_version)
AS_ROOT: tuple[Maker, ...] = (full_disk,)
"""Rows that need a file system of their own."""
