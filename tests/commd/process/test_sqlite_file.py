"""Each damaged file is told at its start, whichever byte was hit."""

import random
import shutil
import sqlite3
import tracemalloc
from pathlib import Path

import pytest

from agentd.mind.persistence.rows import MindRows
from agentd.persistence.checkpoint import AgentRows, Checkpoint
from commd.mail.store import open_store
from commd.process.sqlite_file import PageChecksums, log_damage

HITS = 15


def _hit(path: Path, chance: random.Random) -> None:
    """Flip one bit of a file."""
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(bytes(data))


def _checkpoint(folder: Path) -> Path:
    path = folder / "a.minds"
    made = Checkpoint.open(path)
    for round_ in range(20):
        rows = [(rank, random.Random(rank).randbytes(300)) for rank in range(round_ * 10, round_ * 10 + 10)]
        made.save({"a": AgentRows(mind=MindRows(beliefs=rows))})
    made.close()
    return path


@pytest.mark.parametrize("seed", range(HITS))
def test_a_bit_of_a_checkpoint_that_is_hit_is_told(tmp_path: Path, seed: int) -> None:
    path = _checkpoint(tmp_path)
    _hit(path, random.Random(seed))
    made = Checkpoint.open(path)
    assert made.notes
    assert made.read() == {}
    made.close()
    assert path.with_name("a.minds.corrupt-1").exists()
    again = Checkpoint.open(path)
    assert again.notes == []
    again.close()


def test_a_checkpoint_that_is_well_is_read_as_it_was(tmp_path: Path) -> None:
    made = Checkpoint.open(_checkpoint(tmp_path))
    assert made.notes == []
    assert len(made.read()["a"].mind.beliefs) == 200
    made.close()


@pytest.mark.parametrize("seed", range(HITS))
def test_a_bit_of_the_log_of_a_killed_checkpoint_that_is_hit_is_told(tmp_path: Path, seed: int) -> None:
    (tmp_path / "live").mkdir()
    path = tmp_path / "live" / "a.minds"
    made = Checkpoint.open(path)
    for rank in range(40):
        made.save({"a": AgentRows(mind=MindRows(beliefs=[(rank, random.Random(rank).randbytes(300))]))})
    shutil.copytree(path.parent, tmp_path / "killed")  # as kill -9 leaves it
    made.close()
    killed = tmp_path / "killed" / "a.minds"
    assert log_damage(killed) == ""
    assert PageChecksums(killed).damage() == ""
    _hit(killed.with_name("a.minds-wal"), random.Random(seed))
    again = Checkpoint.open(killed)
    assert again.notes
    again.close()


@pytest.mark.parametrize("seed", range(HITS))
async def test_a_bit_of_a_mail_file_that_is_hit_is_told(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "pi1.mail"

    def fill(db: sqlite3.Connection) -> None:
        row = (1, "b", "a", "b", "n", 1, 0.0, None, 3, b"abc")
        db.executemany("INSERT INTO mail VALUES(?,?,?,?,?,?,?,?,?,?)", [(n, *row[1:]) for n in range(1, 200)])

    async with open_store(path) as store:
        await store.write(fill)
    _hit(path, random.Random(seed))
    async with open_store(path) as store:
        assert list(store.file.set_aside) == ["pi1.mail.corrupt-1"]
    async with open_store(path) as store:
        assert (store.file.set_aside, store.file.damaged) == ({}, [])


def test_a_long_log_is_carried_over_without_holding_it_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "long.db"
    sums = PageChecksums(path)
    database = sqlite3.connect(path, isolation_level=None)
    database.execute("PRAGMA journal_mode = WAL")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    sums.carry_over(database)
    database.execute("CREATE TABLE t (data)")
    database.execute("INSERT INTO t VALUES (?)", (bytes(4_000_000),))
    tracemalloc.start()
    try:
        sums.carry_over(database)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 1_000_000
    database.close()
    sums.close()
    assert PageChecksums(path).damage() == ""
