"""The file that an agent survives in: all or nothing at each save, whatever happens to process, disk and file."""

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agentd.mind.data.inputs import GoalAdded
from agentd.mind.persistence.rows import MindRows
from agentd.persistence.checkpoint import (
    MIGRATIONS,
    ActionInFlight,
    AgentRows,
    Checkpoint,
    CheckpointError,
    LifeRow,
    Outgoing,
    remove,
)
from tests.agentd.kept_minds import Life, state_of
from tests.agentd.minds import term


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "fleet" / "scout.minds"


def belief(number: int, data: bytes = b"x") -> dict[str, AgentRows]:
    return {"scout": AgentRows(mind=MindRows(beliefs=[(number, data)]))}


FULL = AgentRows(
    mind=MindRows(
        beliefs=[(2, b"two"), (-1, b"last"), (1, b"one")],
        predicates=[(0, b"p")],
        plans=[(-1, b"first"), (1, b"end")],
        pending=[((1, 3), 1, b"own"), ((0, 7), 2, b"others")],
        values={"counts": b"c"},
    ),
    absorbed={("ann", "n1"): 5, ("ann", "n2"): 2},
    outgoing=[Outgoing(1, "ann", 1, b"m1"), Outgoing(2, "cid", 1, b"m2")],
    next_seq={"ann": 2, "cid": 2},
    incoming=[(4, b"i4"), (5, b"i5")],
    actions={"scout:b:1": ActionInFlight("goto", b"p")},
    life=LifeRow("mine", 3, b"digest"),
)


def full(path: Path) -> Checkpoint:
    """A checkpoint of scout with `FULL` in it."""
    checkpoint = Checkpoint.open(path)
    checkpoint.save({"scout": FULL})
    return checkpoint


def content(checkpoint: Checkpoint) -> AgentRows:
    return checkpoint.read()["scout"]


def test_everything_that_was_saved_is_read_in_the_next_life(path: Path) -> None:
    full(path).close()
    stored = content(Checkpoint.open(path))
    assert stored.mind.beliefs == [(-1, b"last"), (1, b"one"), (2, b"two")]
    assert stored.mind.predicates == [(0, b"p")]
    assert stored.mind.plans == [(-1, b"first"), (1, b"end")]
    assert stored.mind.pending == [((0, 7), 2, b"others"), ((1, 3), 1, b"own")]
    assert stored.mind.values == {"counts": b"c"}
    assert stored.absorbed == FULL.absorbed
    assert stored.incoming == FULL.incoming
    assert stored.outgoing == FULL.outgoing
    assert stored.next_seq == FULL.next_seq
    assert stored.actions == FULL.actions
    assert stored.life == FULL.life


def test_a_save_changes_what_it_names_and_leaves_the_rest(path: Path) -> None:
    checkpoint = full(path)
    changes = MindRows(
        beliefs=[(3, b"three")], beliefs_gone=[1, 99], plans_gone=[1], pending_gone=[(0, 7)], values={"counts": b"d"}
    )
    checkpoint.save(
        {"scout": AgentRows(mind=changes, absorbed={("ann", "n1"): 6}, taken=[4], delivered=[1], ended=["scout:b:1"])}
    )
    stored = content(checkpoint)
    assert stored.mind.beliefs == [(-1, b"last"), (2, b"two"), (3, b"three")]
    assert stored.mind.plans == [(-1, b"first")]
    assert stored.mind.pending == [((1, 3), 1, b"own")]
    assert stored.mind.values == {"counts": b"d"}
    assert stored.absorbed == {("ann", "n1"): 6, ("ann", "n2"): 2}
    assert stored.incoming == [(5, b"i5")]
    assert [one.number for one in stored.outgoing] == [2]
    assert stored.actions == {}
    assert stored.life == FULL.life


def test_the_last_number_taken_never_falls(path: Path) -> None:
    checkpoint = Checkpoint.open(path)
    for seq in (5, 3):
        checkpoint.save({"scout": AgentRows(absorbed={("ann", "n"): seq})})
    stored = content(checkpoint)
    assert stored.absorbed == {("ann", "n"): 5}


def test_of_each_sender_the_last_used_numberings_are_remembered(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.persistence.checkpoint.NUMBERINGS", 8)
    checkpoint = Checkpoint.open(path)
    for number in range(12):
        checkpoint.save(
            {"scout": AgentRows(absorbed={("ann", f"n{number}"): 1, ("cid", "n"): number, ("ann", "n0"): number})}
        )
    stored = content(checkpoint)
    assert set(stored.absorbed) == {("cid", "n"), ("ann", "n0"), *[("ann", f"n{n}") for n in range(5, 12)]}


@given(st.lists(st.tuples(st.sampled_from("+-!"), st.integers(-4, 4)), max_size=12), st.integers(0, 12))
@settings(deadline=None, max_examples=25)
def test_whatever_is_saved_in_turn_a_file_copied_at_any_moment_holds_a_state_that_was(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[str, int]], cut: int
) -> None:
    folder = tmp_path_factory.mktemp("checkpoint")
    checkpoint = Checkpoint.open(folder / "scout.minds", "NORMAL")
    wanted, copied = dict[int, bytes](), None
    for place, (kind, number) in enumerate(steps):
        if place == cut:
            copied = _copy(folder), dict(wanted)
        gone = [number] if kind == "-" else []
        data = f"{kind}{place}".encode()
        checkpoint.save(
            {"scout": AgentRows(mind=MindRows(beliefs=[] if gone else [(number, data)], beliefs_gone=gone))}
        )
        wanted.pop(number, None)
        if not gone:
            wanted[number] = data
    copied = copied or (_copy(folder), dict(wanted))
    for where, state in (copied, (_copy(folder, "end"), wanted)):
        again = Checkpoint.open(where)
        stored = again.read()
        assert again.notes == []
        assert (dict(stored["scout"].mind.beliefs) if stored else {}) == state
        again.close()
    checkpoint.close()


def _copy(folder: Path, name: str = "copy") -> Path:
    """What a process that is killed now leaves behind."""
    (folder / name).mkdir()
    for file in folder.glob("scout.minds*"):
        shutil.copy(file, folder / name / file.name)
    return folder / name / "scout.minds"


_SAVER = """
import sys
from pathlib import Path
from agentd.persistence.checkpoint import Checkpoint, Outgoing, AgentRows
from agentd.mind.persistence.rows import MindRows
checkpoint = Checkpoint.open(Path(sys.argv[1]))
stored = checkpoint.read()
number = stored["scout"].next_seq["ann"] if stored else 0
while True:
    number += 1
    rows = [(n, str(number).encode()) for n in range(40)]
    message = Outgoing(number, "ann", number, b"x" * 3000)
    saving = AgentRows(mind=MindRows(beliefs=rows), outgoing=[message], delivered=[number - 20])
    saving.next_seq, saving.absorbed = {"ann": number}, {("ann", "n"): number}
    other = AgentRows(mind=MindRows(beliefs=[(1, str(number).encode())]))
    checkpoint.save({"scout": saving, "other": other}, soft=number % 3 == 0)
    print(number, flush=True)
"""


def test_a_process_killed_at_any_moment_leaves_a_whole_save_and_none_that_it_announced_is_missing(path: Path) -> None:
    for lines in (1, 7, 30):
        process = subprocess.Popen([sys.executable, "-c", _SAVER, str(path)], stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            for _ in range(lines):
                last = int(process.stdout.readline())
        finally:
            process.send_signal(signal.SIGKILL)
            rest, _ = process.communicate(timeout=90)
        last = int(rest.split()[-1]) if rest.endswith("\n") and rest.split() else last
        checkpoint = Checkpoint.open(path)
        both = checkpoint.read()
        stored = both["scout"]
        checkpoint.close()
        assert checkpoint.notes == []
        number = stored.next_seq["ann"]
        assert number >= last
        assert stored.absorbed == {("ann", "n"): number}
        assert {data for one in both.values() for _, data in one.mind.beliefs} == {str(number).encode()}
        assert [one.number for one in stored.outgoing] == list(range(max(1, number - 19), number + 1))


def test_a_save_that_fails_half_way_writes_nothing_and_can_be_saved_again(path: Path) -> None:
    checkpoint = full(path)
    saving = AgentRows(mind=MindRows(beliefs=[(5, b"five")]), actions={"id": ActionInFlight("go", None)})  # type: ignore[arg-type]
    with pytest.raises(CheckpointError, match=r"scout\.minds cannot be written: NOT NULL"):
        checkpoint.save({"scout": saving})
    stored = content(checkpoint)
    assert (5, b"five") not in stored.mind.beliefs
    saving.actions = {}
    checkpoint.save({"scout": saving})
    stored = content(checkpoint)
    assert (5, b"five") in stored.mind.beliefs


class Failing:
    """A connection of which nothing works any more but closing it."""

    in_transaction = True

    def __init__(self, database: sqlite3.Connection) -> None:
        self._database = database

    def execute(self, *_: object) -> None:
        raise sqlite3.OperationalError("disk I/O error")

    def close(self) -> None:
        self._database.close()


def test_what_is_saved_into_a_file_made_again_is_read_by_the_next_life(path: Path) -> None:
    checkpoint = full(path)
    assert checkpoint._database is not None
    checkpoint._database = Failing(checkpoint._database)  # type: ignore[assignment]
    with pytest.raises(CheckpointError, match="disk I/O error"):
        checkpoint.save(belief(5))
    remove(path)
    checkpoint.save(belief(5))
    checkpoint.close()
    stored = content(Checkpoint.open(path))
    assert stored.mind.beliefs == [(5, b"x")]


def test_a_full_disk_is_reported_nothing_is_lost_and_the_same_save_succeeds_when_there_is_room(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoint = full(path)
    (pages,) = checkpoint._database.execute("PRAGMA page_count").fetchone()
    checkpoint._database.execute(f"PRAGMA max_page_count={pages + 4}")
    large = AgentRows(outgoing=[Outgoing(9, "ann", 9, b"x" * 100_000)], absorbed={("ann", "n1"): 9})
    for _ in range(3):
        with pytest.raises(CheckpointError, match="full"):
            checkpoint.save({"scout": large})
    checkpoint.save({"scout": AgentRows(absorbed={("ann", "n2"): 3})})
    checkpoint._database.execute("PRAGMA max_page_count=1073741823")
    checkpoint.save({"scout": large})
    stored = content(checkpoint)
    assert stored.absorbed == {("ann", "n1"): 9, ("ann", "n2"): 3}
    assert [one.number for one in stored.outgoing] == [1, 2, 9]


@pytest.mark.parametrize("damage", ["garbage", "empty head", "middle", "cut", "log", "schema"])
def test_a_corrupt_file_is_set_aside_and_reported_and_a_new_one_made(path: Path, damage: str) -> None:
    checkpoint = Checkpoint.open(path)
    checkpoint.save({"scout": AgentRows(mind=MindRows(beliefs=[(n, bytes(200)) for n in range(500)]))})
    checkpoint.close()
    data = bytearray(path.read_bytes())
    match damage:
        case "garbage":
            path.write_bytes(os.urandom(5000))
        case "empty head":
            path.write_bytes(bytes(100) + data[100:])
        case "middle":
            data[20 * 1024 : 40 * 1024] = b"\xa5" * (20 * 1024)
            path.write_bytes(data)
        case "cut":
            path.write_bytes(data[: len(data) // 2])
        case "schema":  # SQLite quotes it in its message, which is no UTF-8 then
            path.write_bytes(data.replace(b"INTEGER PRIMARY KEY", b"INTEGER PRIMARY \xcbEY", 1))
            path.with_name("scout.minds.sums").unlink()
        case "log":
            path.write_bytes(b"no database" * 1000)
            path.with_name("scout.minds-wal").write_bytes(os.urandom(3000))
    before = path.read_bytes()
    again = Checkpoint.open(path)
    assert again.read() == {}
    (note,) = again.notes
    assert note.identity == ("state_damaged", "file")
    assert "scout.minds.corrupt-1" in note.text
    again.save({"scout": FULL})
    assert again.read() != {}
    assert path.with_name("scout.minds.corrupt-1").read_bytes() == before


def test_each_corrupt_file_is_set_aside_under_a_name_of_its_own(path: Path) -> None:
    path.parent.mkdir(parents=True)
    for number in (1, 2, 3):
        path.write_bytes(b"garbage" * 300)
        checkpoint = Checkpoint.open(path)
        checkpoint.close()
        assert f"corrupt-{number}:" in checkpoint.notes[0].text
    assert len(list(path.parent.glob("*.corrupt-?"))) == 3


def test_an_empty_file_is_as_none(path: Path) -> None:
    path.parent.mkdir(parents=True)
    path.touch()
    checkpoint = Checkpoint.open(path)
    assert checkpoint.notes == []
    checkpoint.save({"scout": FULL})


def test_a_database_of_something_else_is_set_aside(path: Path) -> None:
    path.parent.mkdir(parents=True)
    other = sqlite3.connect(path)
    other.execute("CREATE TABLE belief (x)")
    other.commit()
    other.close()
    assert [note.identity for note in Checkpoint.open(path).notes] == [("state_damaged", "file")]


def test_the_state_of_an_agent_is_removed_and_that_of_the_others_stays(path: Path) -> None:
    checkpoint = full(path)
    checkpoint.save({"rescuer": FULL})
    checkpoint.forget(["scout", "nobody"])
    assert list(checkpoint.read()) == ["rescuer"]
    checkpoint.save(belief(5))
    checkpoint.close()
    again = Checkpoint.open(path).read()
    assert again["scout"].mind.beliefs == [(5, b"x")]
    assert (again["rescuer"].outgoing, again["rescuer"].life) == (FULL.outgoing, FULL.life)


def test_a_file_that_is_in_use_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commd.process.sqlite_file.LOCK_PATIENCE", 0.05)
    checkpoint = Checkpoint.open(path)
    with pytest.raises(CheckpointError, match="another process has it open"):
        Checkpoint.open(path)
    checkpoint.save({"scout": FULL})
    checkpoint.close()
    assert Checkpoint.open(path).read() != {}


def test_a_folder_that_cannot_be_made_is_reported(tmp_path: Path) -> None:
    (tmp_path / "fleet").touch()
    with pytest.raises(CheckpointError, match=r"scout\.minds cannot be opened"):
        Checkpoint.open(tmp_path / "fleet" / "scout.minds")


def test_an_older_file_is_brought_to_the_present_version_once(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full(path).close()
    script = "ALTER TABLE belief ADD COLUMN note TEXT DEFAULT 'none'; UPDATE belief SET note = 'migrated'"
    monkeypatch.setattr("agentd.persistence.checkpoint.MIGRATIONS", (*MIGRATIONS, script))
    for _ in range(2):
        again = Checkpoint.open(path)
        assert again._database.execute("SELECT DISTINCT note FROM belief").fetchall() == [("migrated",)]
        assert again._database.execute("PRAGMA user_version").fetchone() == (2,)
        again.close()
    assert again.notes == []


def test_a_migration_that_fails_leaves_the_file_as_it_was(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full(path).close()
    with monkeypatch.context() as patched:
        patched.setattr("agentd.persistence.checkpoint.MIGRATIONS", (*MIGRATIONS, "DELETE FROM belief; NONSENSE"))
        with pytest.raises(CheckpointError, match="NONSENSE"):
            Checkpoint.open(path)
    stored = content(Checkpoint.open(path))
    assert len(stored.mind.beliefs) == 3


def test_a_forgotten_file_is_gone_with_all_that_belongs_to_it(path: Path) -> None:
    checkpoint = full(path)
    checkpoint.forget(["scout"])
    checkpoint.close()
    assert list(path.parent.iterdir()) == []
    assert Checkpoint.open(path).read() == {}


@pytest.mark.parametrize(("soft", "level"), [(True, 1), (False, 2)])
def test_a_soft_save_does_not_wait_for_the_disk_and_the_next_one_does(path: Path, soft: bool, level: int) -> None:
    checkpoint = Checkpoint.open(path, "FULL")
    for _ in range(2):
        checkpoint.save(belief(1), soft=not soft)
        checkpoint.save(belief(1), soft=soft)
        assert checkpoint._database.execute("PRAGMA synchronous").fetchone() == (level,)


def test_a_mind_goes_through_the_file_and_comes_back_the_same(path: Path) -> None:
    source = "p(1). p(X) :- q(X). !start. +!start <- +q(2). +!g(X) <- +got(X); .wait(10000); +never. +!put(X) <- +X."
    checkpoint = Checkpoint.open(path)
    life = Life(source).settle()
    for n in range(5):
        checkpoint.save({"scout": AgentRows(mind=life.keeper.changes())})
        life.feed(GoalAdded(term(f"g({n})")), GoalAdded(term(f"put(at({n})[source(ann)])")))
    checkpoint.save({"scout": AgentRows(mind=life.keeper.changes())})
    checkpoint.close()
    stored = content(Checkpoint.open(path))
    again = Life(source, stored.mind)
    assert state_of(again.mind) == state_of(life.mind)
    assert [str(one) for one in again.keeper.pending_own] == [f"+!g({n})[source(self)]" for n in range(5)]
