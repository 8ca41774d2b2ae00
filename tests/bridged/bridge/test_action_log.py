"""The ids of the last hour outlive the bridge, whatever state the file is in."""

import os
import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event
from unittest.mock import Mock

import pytest

from bridged.bridge import action_log as module
from bridged.bridge.action_log import KEEP, ActionLog, Entry
from schemas.wire.records import Action, ActionStatus


def soon(wish: Callable[[], bool], what: str) -> None:
    """Wait until another thread has made a wish true."""
    pause = Event()
    for _ in range(3000):
        if wish():
            return
        pause.wait(0.01)
    raise AssertionError(f"{what} did not happen within 30 s")


Life = Callable[..., ActionLog]


@pytest.fixture
def life(tmp_path: Path) -> Iterator[Life]:
    """Opens the action log of a robot; what was open before is closed, as at the end of a life of the bridge."""
    lives: list[ActionLog] = []

    def begin(wall: Callable[[], float] = time.time) -> ActionLog:
        if lives:
            lives[-1].close()
        lives.append(ActionLog(tmp_path / "uav1.actions", wall))
        return lives[-1]

    yield begin
    if lives:
        lives[-1].close()


class Wall:
    """A wall clock that a test sets."""

    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


def begun(action: str) -> Action:
    return Action(id=action, agent=action.partition(":")[0], name="land")


def known(action_log: ActionLog, action: str) -> bool:
    return action_log.entries.get(action) is not None


def final(action_log: ActionLog, action: str) -> ActionStatus | None:
    entry = action_log.entries.get(action)
    return entry.final


def ended(action: str) -> ActionStatus:
    return ActionStatus(id=action, state="succeeded", result=True, name="land")


def test_an_id_is_known_from_its_beginning_and_its_end_is_kept(life: Life) -> None:
    action_log = life()
    assert not known(action_log, "a:1")
    action_log.begin(begun("a:1"))
    assert known(action_log, "a:1")
    assert final(action_log, "a:1") is None
    action_log.finish("a", ended("a:1"))
    action_log.begin(begun("a:2"))
    again = life()
    assert final(again, "a:1") == ended("a:1")
    assert known(again, "a:2")
    assert final(again, "a:2") is None


def test_a_line_cut_off_by_a_power_loss_costs_only_itself(life: Life, tmp_path: Path) -> None:
    path, action_log = tmp_path / "uav1.actions", life()
    action_log.begin(begun("a:1"))
    action_log.begin(begun("a:2"))
    action_log.close()
    path.write_bytes(path.read_bytes()[:-7] + b"\xff\xfe\n{}")
    again = life()
    assert known(again, "a:1")
    assert not known(again, "a:2")


def test_the_last_ids_are_known_though_the_clock_was_set_forward(life: Life) -> None:
    wall = Wall()
    action_log = life(wall)
    action_log.begin(begun("a:1"))
    wall.time += 24 * KEEP
    again = life(wall)
    again.begin(begun("a:2"))
    assert known(again, "a:1")
    assert again.held() == ("a", False)


def test_ids_of_over_an_hour_are_forgotten(life: Life, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LAST", 1)
    wall, path = Wall(), tmp_path / "uav1.actions"
    action_log = life(wall)
    for number in range(100):
        action_log.begin(begun(f"a:{number}"))
        action_log.finish("a", ended(f"a:{number}"))
    size = path.stat().st_size
    wall.time += KEEP + 1
    action_log.begin(begun("b:1"))
    assert not known(action_log, "a:99")
    action_log = life(wall)
    assert known(action_log, "b:1")
    assert path.stat().st_size < size / 100


def rewritten(action_log: ActionLog) -> bool:
    """Whether what is written anew by a thread waits to be put in the place of the old file."""
    return action_log._rewriting is not None and action_log._rewriting.done()


def test_a_disk_that_is_full_while_the_file_shrinks_costs_no_later_id(
    life: Life, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("bridged.bridge.action_log.REWRITE_AT", 1)
    action_log = life()
    monkeypatch.setattr(
        "bridged.bridge.action_log.Path.replace", Mock(side_effect=OSError(28, "No space left on device"))
    )
    action_log.begin(begun("a:1"))
    soon(lambda: rewritten(action_log), "the new file")
    action_log.begin(begun("a:2"))
    action_log.begin(begun("a:3"))
    monkeypatch.undo()
    action_log.close()
    assert "uav1.actions cannot be made smaller: No space left on device" in caplog.text
    again = life()
    assert [known(again, f"a:{number}") for number in (1, 2, 3)] == [True] * 3


def test_what_is_noted_as_the_file_shrinks_is_kept(life: Life, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridged.bridge.action_log.REWRITE_AT", 1)
    wall, path, written, write = Wall(), tmp_path / "uav1.actions", Event(), module._write
    action_log = life(wall)

    def slow(fresh: Path, entries: list[Entry]) -> None:
        write(fresh, entries)
        assert written.wait(30)

    monkeypatch.setattr("bridged.bridge.action_log._write", slow)
    action_log.begin(begun("a:1"))
    action_log.begin(begun("a:2"))
    action_log.finish("a", ended("a:1"))
    written.set()
    soon(lambda: rewritten(action_log), "the new file")
    before = path.stat().st_ino
    action_log.begin(begun("a:3"))
    assert path.stat().st_ino != before
    action_log.begin(begun("a:4"))
    monkeypatch.undo()
    again = life(wall)
    assert [known(again, f"a:{number}") for number in range(1, 5)] == [True] * 4
    assert final(again, "a:1") == ended("a:1")


def test_a_file_whose_ids_are_all_of_the_last_hour_is_written_anew_only_when_it_has_doubled(
    life: Life, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bridged.bridge.action_log.REWRITE_AT", 1000)
    rewrites, write = list[int](), module._write
    action_log = life()

    def counted(fresh: Path, entries: list[Entry]) -> None:
        rewrites.append(len(entries))
        write(fresh, entries)

    monkeypatch.setattr("bridged.bridge.action_log._write", counted)
    for number in range(2000):
        action_log.finish("a", ended(f"a:{number}"))
        if action_log._rewriting is not None:
            soon(lambda: rewritten(action_log), "the new file")
    assert 5 <= len(rewrites) <= 8, "1000 bytes, 2000, 4000 and so on"


def test_a_slow_disk_holds_nothing_up_and_every_id_is_synced_in_the_end(
    life: Life, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, fsync, synced = tmp_path / "uav1.actions", os.fsync, list[int]()
    busy, disk = Event(), Event()
    action_log = life()

    def slow(file: int) -> None:
        seen = os.fstat(file)
        ours = seen.st_ino == path.stat().st_ino  # an action log of an earlier test may still be at it
        if ours:
            busy.set()
            assert disk.wait(30)
        fsync(file)
        if ours:
            synced.append(seen.st_size)

    monkeypatch.setattr("bridged.bridge.action_log.os.fsync", slow)
    action_log.begin(begun("a:0"))
    action_log.keep()
    assert busy.wait(30)
    for number in range(1, 100):
        action_log.begin(begun(f"a:{number}"))
        action_log.keep()
    assert path.read_bytes().count(b"\n") == 100, "another process would find every id, although nothing is synced"
    assert not synced
    disk.set()
    soon(lambda: len(synced) == 2, "one sync and one more for what came meanwhile")
    assert synced[-1] == path.stat().st_size
    action_log.begin(begun("a:100"))
    action_log.keep()
    soon(lambda: synced[-1] == path.stat().st_size, "the sync of a later id")
    action_log.finish("a", ended("a:100"))
    soon(lambda: synced[-1] == path.stat().st_size, "the sync of its end, which is answered after a power failure too")


FULL = Mock(side_effect=OSError(28, "No space left on device"))


def codes(action_log: ActionLog) -> list[str]:
    return [note.code for note in action_log.notes()]


def has_space_again(action_log: ActionLog, now: float) -> None:
    action_log.step(now)
    soon(lambda: rewritten(action_log), "the new file")
    action_log.step(now)


@pytest.mark.parametrize("at", ["_write", "make_private_folder"])
def test_a_disk_that_is_full_at_the_start_is_done_without_and_taken_up_again(
    life: Life, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, at: str
) -> None:
    path = tmp_path / "uav1.actions"
    before = life()
    before.begin(begun("a:1"))
    before.hold("a", free=False)
    before.order("rtl")
    before.close()
    monkeypatch.setattr(module, at, FULL)
    action_log = life()
    assert (known(action_log, "a:1"), action_log.held(), action_log.ordered) == (True, ("a", False), "rtl")
    assert codes(action_log) == ["ledger_failing"]
    with pytest.raises(OSError, match="No space left on device"):
        action_log.begin(begun("a:2"))
    action_log.order(None)
    has_space_again(action_log, 10.0)
    assert codes(action_log) == ["ledger_failing"]
    monkeypatch.undo()
    action_log.step(10.5)
    assert not rewritten(action_log), "it is tried once a second"
    has_space_again(action_log, 11.0)
    assert codes(action_log) == []
    action_log.begin(begun("a:3"))
    action_log.close()
    assert [one.message for one in caplog.records] == [
        f"robot=uav1 {path} cannot be written: No space left on device",
        "robot=uav1 the operator's order cannot be kept on disk: No space left on device",
        f"robot=uav1 {path} can be written again",
    ]
    again = life()
    assert [known(again, f"a:{number}") for number in (1, 2, 3)] == [True] * 3
    assert again.ordered is None, "as the operator said while the disk was full"


def test_a_disk_that_fills_up_is_taken_up_again_with_what_was_recorded_meanwhile(life: Life) -> None:
    action_log = life()
    action_log.begin(begun("a:1"))
    action_log._file = Mock(wraps=action_log._file, write=Mock(return_value=3))
    action_log.pause(True)
    assert (codes(action_log), action_log.paused) == (["ledger_failing"], True)
    action_log.step(0.0)
    with pytest.raises(OSError, match="No space left on device"):
        action_log.begin(begun("a:2"))
    soon(lambda: rewritten(action_log), "the new file")
    action_log.step(0.0)
    assert codes(action_log) == []
    again = life()
    assert (known(again, "a:1"), known(again, "a:2"), again.paused) == (True, True, True)


def test_the_end_with_a_full_disk_is_an_error_in_the_log(
    life: Life, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "uav1.actions"
    monkeypatch.setattr(module, "_write", FULL)
    action_log = life()
    action_log.close()
    assert caplog.records[-1].message == f"robot=uav1 {path} ends without what could not be written"


def test_a_file_that_cannot_be_read_is_told(life: Life, monkeypatch: pytest.MonkeyPatch) -> None:
    life().close()
    monkeypatch.setattr(module.Path, "read_bytes", Mock(side_effect=OSError(5, "Input/output error")))
    action_log = life()
    assert codes(action_log) == ["ledger_damaged"]


def test_a_failed_sync_is_said(life: Life, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    action_log = life()
    monkeypatch.setattr("bridged.bridge.action_log.os.fsync", Mock(side_effect=OSError(5, "Input/output error")))
    action_log.begin(begun("a:1"))
    action_log.keep()
    soon(lambda: bool(caplog.records), "the log line")
    assert caplog.records[0].message == "action ids may not outlive a power loss: Input/output error"


def test_no_more_ids_are_kept_than_fit_and_the_oldest_goes_first(life: Life, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_ENTRIES", 10)
    monkeypatch.setattr(module, "LAST", 5)
    action_log = life()
    for number in range(12):
        action_log.begin(begun(f"a:{number}"))
    assert [known(action_log, f"a:{number}") for number in range(4)] == [False, False, True, True]


def test_who_has_the_robot_is_kept_beside_the_ids(life: Life) -> None:
    action_log = life()
    assert action_log.held() == ("", False)
    action_log.begin(begun("a:b:1"))
    assert action_log.held() == ("a", False), "no line says it: whose action was begun last"
    action_log.hold("c", free=True)
    action_log.begin(begun("a:b:2"))
    again = life()
    assert again.held() == ("c", True)
    assert not known(again, "c")


@pytest.mark.parametrize("days", [365, -365])
def test_a_clock_that_is_wrong_after_a_reboot_of_the_machine_takes_the_robot_from_nobody(
    life: Life, monkeypatch: pytest.MonkeyPatch, days: int
) -> None:
    monkeypatch.setenv("ARGOSY_BOOT", "first")
    wall = Wall()
    life(wall).begin(begun("a:1"))
    monkeypatch.setenv("ARGOSY_BOOT", "second")
    wall.time += days * 24 * KEEP
    action_log = life(wall)
    assert action_log.held() == ("a", False)
    action_log.hold("b", free=True)
    wall.time += days * 24 * KEEP
    assert life(wall).held() == ("b", True)


def test_what_the_operator_has_said_is_kept_however_old_it_is_and_however_often_the_file_is_made_smaller(
    life: Life, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "REWRITE_AT", 2_000)
    path, now = tmp_path / "uav1.actions", [1_000.0]
    action_log = life(lambda: now[0])
    action_log.order("hold")
    action_log.pause(True)
    for number in range(100):
        now[0] += 100
        action_log.begin(begun(f"a:{number}"))
    again = life(lambda: now[0])
    assert (again.ordered, again.paused) == ("hold", True)
    again.order(None)
    again.pause(False)
    last = life(lambda: now[0])
    assert (last.ordered, last.paused) == (None, False)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["uav1.actions"]
    assert path.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("seed", range(15))
def test_a_bit_of_the_file_that_is_hit_is_told(life: Life, tmp_path: Path, seed: int) -> None:
    path, chance = tmp_path / "uav1.actions", random.Random(seed)
    action_log = life()
    for number in range(20):
        action_log.begin(Action(id=f"a{number}", agent="uav1", name="goto"))
    action_log.close()
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(bytes(data))
    again = life()
    assert [(note.code, note.value) for note in again.notes()] == [("ledger_damaged", 1)]
    well = life()
    assert not well.notes()


def test_the_sync_of_an_end_is_that_of_its_beginning_too(life: Life, monkeypatch: pytest.MonkeyPatch) -> None:
    synced = Mock()
    monkeypatch.setattr("bridged.bridge.action_log._sync", lambda file: (os.close(file), synced()))
    action_log = life()
    for number in range(3):
        action_log.begin(begun(f"a{number}"))
        action_log.finish("uav", ended(f"a{number}"))
        soon(lambda so_far=number + 1: synced.call_count == so_far, "a sync")  # type: ignore[misc]
        action_log.keep()
    action_log.close()
    action_log._syncer.shutdown()
    assert synced.call_count == 3
