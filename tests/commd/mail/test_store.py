"""The file of the mail: what is said to be on disk is there, whatever happens to the process, the disk or the file."""

import asyncio
import os
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractAsyncContextManager, suppress
from pathlib import Path
from sqlite3 import Connection

import pytest

from commd.mail import queries
from commd.mail import store as store_module
from commd.mail.store import QUEUE, Store, StoreFailed, open_store
from schemas.files.findings import Findings
from tests.support.buses import until


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "fleet" / "pi1.mail"


@pytest.fixture
def store(path: Path) -> AbstractAsyncContextManager[Store]:
    return open_store(path)


def keep(name: str, value: bytes = b"x") -> Callable[[Connection], None]:
    return lambda db: queries.keep(db, "test", name, value)


def kept(db: Connection) -> dict[str, bytes]:
    return queries.kept(db, "test")


KEEP_AND_DIE = """
import asyncio, os, sys
from pathlib import Path
from commd.mail import queries
from commd.mail.store import open_store

async def main():
    async with open_store(Path(sys.argv[1])) as store:
        await store.write(lambda db: queries.keep(db, "test", "a", b"1"))
        os.kill(os.getpid(), 9)

asyncio.run(main())
"""


def rewrite(path: Path, change: Callable[[bytes], bytes]) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(change(path.read_bytes() if path.exists() else b""))


def keep_and_die(path: Path) -> None:
    assert subprocess.run([sys.executable, "-c", KEEP_AND_DIE, str(path)], timeout=90).returncode == -9


async def test_what_was_written_is_there_when_the_process_was_killed_at_once(path: Path) -> None:
    keep_and_die(path)
    async with open_store(path) as store:
        assert await store.read(kept) == {"a": b"1"}


@pytest.mark.parametrize(("synchronous", "number"), [("full", 2), ("normal", 1)])
async def test_the_file_is_written_as_the_mission_says(path: Path, synchronous: str, number: int) -> None:
    async with open_store(path, synchronous) as store:
        assert await store.write(lambda db: db.execute("PRAGMA synchronous").fetchone()) == (number,)
        assert await store.write(lambda db: db.execute("PRAGMA journal_mode").fetchone()) == ("wal",)


async def test_what_waits_at_the_same_time_shares_a_commit(store: Store) -> None:
    await asyncio.gather(*(store.write(keep(f"n{number:03}")) for number in range(200)))
    assert len(await store.read(kept)) == 200
    assert store.counters["commits"] <= 3


async def test_a_transaction_that_fails_undoes_nothing_but_itself(store: Store) -> None:
    def fails(db: Connection) -> None:
        keep("bad")(db)
        raise ValueError("a defect")

    outcomes = await asyncio.gather(
        store.write(keep("before")), store.write(fails), store.write(keep("after")), return_exceptions=True
    )
    assert [str(one) for one in outcomes] == ["None", "a defect", "None"]
    assert list(await store.read(kept)) == ["after", "before"]
    with pytest.raises(sqlite3.OperationalError, match="no such table"):
        await store.write(lambda db: db.execute("SELECT * FROM nowhere"))
    assert not store.note, "a defect is nothing that is wrong with the disk"


async def test_the_event_loop_goes_on_while_the_disk_is_slow(store: Store) -> None:
    slow, began = threading.Event(), threading.Event()
    writing = asyncio.create_task(store.write(lambda db: began.set() or slow.wait(20)))
    reading = asyncio.create_task(store.read(lambda db: slow.wait(20)))
    await until(began.is_set, "the disk hangs")
    slow.set()  # if the loop had to wait for the disk nobody would come here
    assert await writing
    assert await reading


async def test_more_transactions_than_may_wait_are_turned_away_at_once(store: Store) -> None:
    slow, began = threading.Event(), threading.Event()

    def hang(db: Connection) -> None:
        began.set()
        slow.wait(20)

    first = asyncio.create_task(store.write(hang))
    await until(began.is_set, "the disk hangs")
    waiting = [asyncio.create_task(store.write(keep("a"))) for _ in range(QUEUE)]
    await asyncio.sleep(0)
    with pytest.raises(StoreFailed, match="busy: 1000 transactions wait for the disk"):
        await store.write(keep("b"))
    slow.set()
    await asyncio.gather(first, *waiting)


async def test_a_full_disk_keeps_nothing_says_so_once_and_goes_on_when_there_is_room(
    store: Store, path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    await store.write(keep("before"))
    (pages,) = await store.write(lambda db: db.execute("PRAGMA page_count").fetchone())
    await store.write(lambda db: db.execute(f"PRAGMA max_page_count = {pages + 2}").fetchone())
    for _ in range(3):
        with pytest.raises(StoreFailed, match=r"^the disk is full$"):
            await store.write(keep("big", bytes(100_000)))
    assert store.counters["db_errors"] == 3
    assert store.note == f"no mail is accepted: the disk is full ({path})"
    assert caplog.text.count("mail_store_failing") == 1
    await store.write(lambda db: db.execute("PRAGMA max_page_count = 1000000").fetchone())
    await store.write(keep("big", bytes(100_000)))
    assert list(await store.read(kept)) == ["before", "big"]
    assert store.note == ""
    assert caplog.text.count("mail_store_well") == 1


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "none", str(folder)], capture_output=True)
    if mounted.returncode:
        pytest.skip(f"a small file system needs root: {mounted.stderr.decode().strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def fill_up(folder: Path, name: str) -> None:
    with (folder / name).open("wb", buffering=0) as filler, suppress(OSError):
        while True:
            filler.write(bytes(4096))


async def test_what_is_said_to_have_failed_is_not_written(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.mail.store.PATIENCE", 0.5)
    async with open_store(path) as store:
        slow, began = threading.Event(), threading.Event()

        def hangs(db: Connection) -> None:
            began.set()
            slow.wait(20)

        first = asyncio.create_task(store.write(hangs))
        await until(began.is_set, "the disk hangs")
        with pytest.raises(StoreFailed, match="has not answered"):
            await store.write(keep("late"))
        given_up = asyncio.create_task(store.write(keep("given_up")))
        await asyncio.sleep(0)
        given_up.cancel()
        await asyncio.wait((given_up, first))
        slow.set()
        monkeypatch.setattr("commd.mail.store.PATIENCE", 20.0)
        await store.write(keep("b"))
        assert list(await store.read(kept)) == ["b"]


async def test_a_board_that_starts_on_a_full_disk_after_a_power_cut_has_its_mail_when_there_is_room(
    small_disk: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(store_module, "OPEN_AGAIN", 0.1)
    path = small_disk / "pi1.mail"
    keep_and_die(path)
    fill_up(small_disk, "filler")
    (small_disk / "pi1.mail-shm").unlink()  # as after a boot
    fill_up(small_disk, "more")
    async with open_store(path) as store:
        assert store.note.startswith("no mail is accepted: "), "it starts all the same"
        with pytest.raises(StoreFailed):
            await store.write(keep("b"))
        with pytest.raises(StoreFailed):
            await store.read(kept)
        (small_disk / "filler").unlink()
        (small_disk / "more").unlink()
        await until(lambda: store.note == "", "it opens its file by itself")
        assert await store.read(kept) == {"a": b"1"}
        await store.write(keep("b"))
    assert caplog.text.count("mail_store_failing") == 1


async def test_a_corrupt_file_is_set_aside_and_a_new_one_begins(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for number in (1, 2):
        rewrite(path, lambda _: os.urandom(8192))
        async with open_store(path) as store:
            assert list(store.file.set_aside) == [f"pi1.mail.corrupt-{number}"]
            assert await store.read(kept) == {}
            await store.write(keep("new"))
            assert list(await store.read(kept)) == ["new"]
        aside = path.with_name(f"pi1.mail.corrupt-{number}")
        assert aside.stat().st_size == 8192
        assert f"set_aside={aside}: what it kept is lost, a new file is made" in caplog.text


async def test_a_file_whose_schema_is_damaged_beyond_utf8_is_set_aside(path: Path) -> None:
    """SQLite quotes the damaged schema in its message, which Python then cannot decode."""
    async with open_store(path) as store:
        await store.write(keep("a"))
    rewrite(path, lambda content: content.replace(b"INTEGER PRIMARY KEY", b"INTEGER PRIMARY \xcbEY", 1))
    path.with_name("pi1.mail.sums").unlink()
    async with open_store(path) as store:
        assert list(store.file.set_aside) == ["pi1.mail.corrupt-1"]


async def test_a_file_with_a_damaged_page_is_found_at_the_start(path: Path) -> None:
    async with open_store(path) as store:
        for number in range(50):
            await store.write(keep(f"n{number}", bytes(3000)))
    rewrite(path, lambda content: content[:20_000] + os.urandom(4_000) + content[24_000:])
    async with open_store(path) as store:
        assert list(store.file.set_aside) == ["pi1.mail.corrupt-1"]


async def test_a_file_that_is_damaged_while_it_is_used_is_set_aside_too(store: Store, path: Path) -> None:
    for number in range(200):
        await store.write(keep(f"n{number:03}", bytes(3000)))
    await store.write(keep("last"))
    checkpointed = sqlite3.connect(path)
    checkpointed.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    checkpointed.close()
    with path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(4096)
        file.write(os.urandom(size - 4096))

    async def read() -> dict[str, bytes]:
        return await store.read(kept)

    with pytest.raises(StoreFailed, match=r"malformed|not a database"):
        await read()
    await until(lambda: list(store.file.set_aside) == ["pi1.mail.corrupt-1"], "the writer sets it aside")
    with suppress(StoreFailed):
        await store.write(keep("lost"))  # may be of the commit that finds the damage
    await store.write(keep("new"))
    assert "new" in await read()
    assert "n000" not in await read()


async def test_a_damaged_file_that_cannot_be_set_aside_now_is_set_aside_later(
    store: Store, path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def damaged(db: Connection) -> None:
        error = sqlite3.DatabaseError("database disk image is malformed")
        error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
        raise error

    def read_only(*_: object) -> Path:
        path.write_bytes(os.urandom(8192))
        raise OSError("read-only file system")

    await store.write(keep("before"))
    with monkeypatch.context() as patched:
        patched.setattr("commd.process.sqlite_file.set_aside", read_only)
        with pytest.raises(StoreFailed, match="malformed"):
            await store.write(damaged)
        with pytest.raises(StoreFailed, match="read-only file system"):
            await store.write(keep("lost"))
        assert "read-only file system" in caplog.text
    await store.write(keep("new"))
    assert list(store.file.set_aside) == ["pi1.mail.corrupt-1"]
    assert list(await store.read(kept)) == ["new"]
    assert store.note == ""


async def test_a_disk_that_was_away_for_a_while_is_used_again(store: Store) -> None:
    def fails(db: Connection) -> None:
        error = sqlite3.OperationalError("disk I/O error")
        error.sqlite_errorcode = sqlite3.SQLITE_IOERR
        raise error

    await store.write(keep("before"))
    before = await store.write(id)
    with pytest.raises(StoreFailed, match="disk I/O error"):
        await store.write(fails)
    with pytest.raises(StoreFailed, match="disk I/O error"):
        await store.read(fails)
    await store.write(keep("after"))
    assert await store.write(id) != before, "by a connection of its own"
    assert list(await store.read(kept)) == ["after", "before"]


async def test_a_defect_in_what_counts_the_file_ends_no_writing(path: Path, caplog: pytest.LogCaptureFixture) -> None:
    faults = [KeyError("a defect")]

    def count(db: Connection) -> None:
        if counting and faults:
            raise faults.pop()

    def fails(db: Connection) -> None:
        raise ValueError("rolled back")

    counting: list[bool] = []
    async with open_store(path, count=count) as store:
        counting.append(True)
        with pytest.raises(StoreFailed, match="defect in argosy: 'a defect'"):
            await store.write(fails)
        await store.write(keep("after"))
        assert list(await store.read(kept)) == ["after"]
    assert "defect in argosy: writing" in caplog.text


async def test_a_file_of_an_older_version_becomes_one_of_this(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with open_store(path) as store:
        await store.write(keep("old"))
    steps = (
        *queries.MIGRATIONS,
        "ALTER TABLE facts ADD COLUMN note TEXT; UPDATE facts SET note = 'from before';",
        "CREATE TABLE further(a); INSERT INTO further VALUES(7);",
    )
    monkeypatch.setattr(queries, "MIGRATIONS", steps)
    for _ in range(2):  # and not once more
        async with open_store(path) as store:
            facts = await store.read(
                lambda db: db.execute("SELECT name, note FROM facts WHERE kind = 'test'").fetchall()
            )
            assert facts == [("old", "from before")]
            assert await store.read(lambda db: db.execute("SELECT a FROM further").fetchall()) == [(7,)]
            assert await store.read(lambda db: db.execute("PRAGMA user_version").fetchone()) == (len(steps),)


async def test_a_failed_migration_leaves_the_file_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with open_store(path) as store:
        await store.write(keep("old"))
    monkeypatch.setattr(
        queries, "MIGRATIONS", (*queries.MIGRATIONS, "CREATE TABLE further(a); INSERT INTO nowhere VALUES(1);")
    )
    with pytest.raises(Findings, match="no such table: nowhere"):
        async with open_store(path):
            pytest.fail("half a migration was taken")
    monkeypatch.undo()
    async with open_store(path) as store:
        assert list(await store.read(kept)) == ["old"]
        tables = await store.read(lambda db: db.execute("SELECT name FROM sqlite_master").fetchall())
        assert ("further",) not in tables


async def test_a_file_belongs_to_one_process(path: Path) -> None:
    async with open_store(path):
        with pytest.raises(Findings, match=r"another commd stores its mail in this file: give each its own --state"):
            async with open_store(path):
                pytest.fail("two have it")
    async with open_store(path) as store:
        await store.write(keep("a"))


async def test_where_no_file_can_be_made_the_start_says_so(tmp_path: Path) -> None:
    (tmp_path / "fleet").write_text("a file where the folder should be")
    with pytest.raises(Findings, match=r"cannot store mail in this file: .*File exists"):
        async with open_store(tmp_path / "fleet" / "pi1.mail"):
            pytest.fail("there is no place for it")


async def test_a_closed_file_takes_nothing_and_says_so(path: Path) -> None:
    async with open_store(path) as store:
        pass
    with pytest.raises(StoreFailed, match="closed"):
        await store.write(keep("a"))
    with pytest.raises(StoreFailed, match="closed"):
        await store.read(kept)
