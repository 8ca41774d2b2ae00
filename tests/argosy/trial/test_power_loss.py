"""What is synced survives a power failure; what is not may be lost from some point on, and no database is corrupt."""

import sqlite3
from pathlib import Path
from random import Random

import pytest

from argosy.trial import power_loss
from argosy.trial.power_loss import Disk, lose_power
from commd.process.sqlite_file import SqliteFile, check

ROWS = 40


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(power_loss, "_synced", {})
    monkeypatch.setattr(power_loss, "_written", {})
    (folder := tmp_path / "fleet").mkdir()
    original = sqlite3.connect

    def connected(path: Path, **options: object) -> sqlite3.Connection:
        made: Disk = original(path, factory=Disk, **options)  # type: ignore[call-overload]
        made.at(path)
        return made

    monkeypatch.setattr(sqlite3, "connect", connected)
    return folder


def test_commits_that_are_synced_survive(state: Path) -> None:
    wal = state / "pi1.mail-wal"
    database = SqliteFile(state / "pi1.mail", (), "FULL").connect()
    database.execute("BEGIN")
    database.execute("CREATE TABLE row (number INTEGER)")
    database.execute("COMMIT")
    written = wal.read_bytes()
    lose_power(state.parent, ["pi1"], Random(1))
    assert wal.read_bytes() == written
    database.close()


def test_last_commits_that_are_not_synced_may_be_lost_and_the_file_stays_whole(state: Path) -> None:
    database = SqliteFile(state / "pi1.mail", (), "NORMAL").connect()
    database.execute("BEGIN")
    database.execute("CREATE TABLE row (number INTEGER)")
    database.execute("COMMIT")
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    for number in range(ROWS):
        database.execute("BEGIN")
        database.execute("INSERT INTO row VALUES (?)", (number,))
        database.execute("COMMIT")
    lose_power(state.parent, ["pi1"], Random(1))
    copy = state / "copy.mail"  # as a process finds it that knows nothing of the one before
    for end in ("", "-wal"):
        copy.with_name(copy.name + end).write_bytes((state / f"pi1.mail{end}").read_bytes())
    again = SqliteFile(copy, (), "FULL").connect()
    check(again)
    left = [number for (number,) in again.execute("SELECT number FROM row ORDER BY number")]
    assert left == list(range(len(left)))
    assert len(left) < ROWS
    for one in (again, database):
        one.close()


def test_what_was_appended_after_the_last_sync_is_lost_in_part(state: Path) -> None:
    path = state / "uav1.actions"
    with path.open("wb") as file:
        file.write(b"x" * 100)
        file.flush()
        power_loss.synced(file.fileno())
        file.write(b"y" * 1000)
    lose_power(state.parent, ["pi1"], Random(1))
    assert path.stat().st_size == 1100
    lose_power(state.parent, ["pi1", "uav1"], Random(1))
    assert 100 <= path.stat().st_size < 1100


def test_what_was_written_long_ago_is_on_the_disk_without_a_sync(state: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wal, now = state / "pi1.mail-wal", 0.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    database = SqliteFile(state / "pi1.mail", (), "NORMAL").connect()
    for number, now in enumerate((0.0, 10.0, 50.0)):
        database.execute("BEGIN")
        database.execute(f"CREATE TABLE t{number} (number INTEGER)")
        database.execute("COMMIT")
        if now == 10.0:
            least = wal.stat().st_size
    lose_power(state.parent, ["pi1"], Random(1))
    assert wal.stat().st_size >= least
    database.close()


def test_the_files_of_an_agent_are_in_its_folder(state: Path) -> None:
    (state / "uav").mkdir()
    (path := state / "uav" / "notes").write_bytes(b"x" * 1000)
    lose_power(state.parent, ["uav"], Random(1))
    assert path.stat().st_size < 1000
