"""The ids of the last hour outlive the bridge, whatever state the file is in."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from threading import Event
from unittest.mock import Mock

import pytest

from bridged import ledger as module
from bridged.ledger import KEEP, Ledger
from schemas.records import ActionStatus


def soon(wish: Callable[[], bool], what: str) -> None:
    """Wait until another thread has made a wish true."""
    pause = Event()
    for _ in range(3000):
        if wish():
            return
        pause.wait(0.01)
    raise AssertionError(f"{what} did not happen within 30 s")


class Wall:
    """A wall clock that a test sets."""

    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


def ended(action: str) -> ActionStatus:
    return ActionStatus(id=action, state="succeeded", result=True, name="land")


def test_an_id_is_known_from_its_beginning_and_its_end_is_kept(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "deep" / "uav1.actions")
    assert not ledger.knows("a:1")
    ledger.begin("a:1")
    assert ledger.knows("a:1")
    assert ledger.final("a:1") is None
    ledger.finish(ended("a:1"))
    ledger.begin("a:2")
    ledger.close()
    again = Ledger(tmp_path / "deep" / "uav1.actions")
    assert again.final("a:1") == ended("a:1")
    assert again.knows("a:2")
    assert again.final("a:2") is None
    again.close()


def test_a_line_cut_off_by_a_power_loss_costs_only_itself(tmp_path: Path) -> None:
    path, ledger = tmp_path / "uav1.actions", Ledger(tmp_path / "uav1.actions")
    ledger.begin("a:1")
    ledger.begin("a:2")
    ledger.close()
    path.write_bytes(path.read_bytes()[:-7] + b"\xff\xfe\n{}")
    again = Ledger(path)
    assert again.knows("a:1")
    assert not again.knows("a:2")
    again.close()


def test_ids_older_than_an_hour_are_forgotten_and_the_file_shrinks(tmp_path: Path) -> None:
    wall, path = Wall(), tmp_path / "uav1.actions"
    ledger = Ledger(path, wall)
    for number in range(100):
        ledger.begin(f"a:{number}")
        ledger.finish(ended(f"a:{number}"))
    size = path.stat().st_size
    wall.time += KEEP + 1
    ledger.begin("b:1")
    assert not ledger.knows("a:99")
    ledger.close()
    ledger = Ledger(path, wall)
    assert ledger.knows("b:1")
    assert path.stat().st_size < size / 100
    ledger.close()


def test_a_disk_that_is_full_while_the_file_shrinks_costs_no_later_id(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ledger = Ledger(tmp_path / "uav1.actions")
    monkeypatch.setattr("bridged.ledger.REWRITE_AT", 1)
    with monkeypatch.context() as full:
        full.setattr("bridged.ledger.Path.replace", Mock(side_effect=OSError(28, "No space left on device")))
        with pytest.raises(OSError, match="No space left"):
            ledger.begin("a:1")
    ledger.begin("a:2")
    ledger.close()
    again = Ledger(tmp_path / "uav1.actions")
    assert again.knows("a:1")
    assert again.knows("a:2")
    again.close()


def test_a_slow_disk_holds_nothing_up_and_every_id_is_synced_in_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, fsync, synced = tmp_path / "uav1.actions", os.fsync, list[int]()
    busy, disk = Event(), Event()
    ledger = Ledger(path)

    def slow(file: int) -> None:
        seen = os.fstat(file)
        ours = seen.st_ino == path.stat().st_ino  # a ledger of an earlier test may still be at it
        if ours:
            busy.set()
            assert disk.wait(30)
        fsync(file)
        if ours:
            synced.append(seen.st_size)

    monkeypatch.setattr("bridged.ledger.os.fsync", slow)
    ledger.begin("a:0")
    assert busy.wait(30)
    for number in range(1, 100):
        ledger.begin(f"a:{number}")
    assert path.read_bytes().count(b"\n") == 100, "another process would find every id, although nothing is synced"
    assert not synced
    disk.set()
    soon(lambda: len(synced) == 2, "one sync and one more for what came meanwhile")
    assert synced[-1] == path.stat().st_size
    ledger.begin("a:100")
    soon(lambda: synced[-1] == path.stat().st_size, "the sync of a later id")
    ledger.close()


def test_a_sync_that_fails_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ledger = Ledger(tmp_path / "uav1.actions")
    monkeypatch.setattr("bridged.ledger.os.fsync", Mock(side_effect=OSError(5, "Input/output error")))
    ledger.begin("a:1")
    soon(lambda: bool(caplog.records), "the log line")
    assert caplog.records[0].message == "action ids may not outlive a power loss: Input/output error"
    ledger.close()


def test_no_more_ids_are_kept_than_fit_and_the_oldest_goes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAX_ENTRIES", 10)
    ledger = Ledger(tmp_path / "uav1.actions")
    for number in range(12):
        ledger.begin(f"a:{number}")
    assert [ledger.knows(f"a:{number}") for number in range(4)] == [False, False, True, True]
    ledger.close()


def test_who_has_the_robot_is_kept_beside_the_ids(tmp_path: Path) -> None:
    path = tmp_path / "uav1.actions"
    ledger = Ledger(path)
    assert ledger.held() == ("", False)
    ledger.begin("a:b:1")
    assert ledger.held() == ("a", False), "no line says it: whose action was begun last"
    ledger.hold("c", free=True)
    ledger.begin("a:b:2")
    ledger.close()
    again = Ledger(path)
    assert again.held() == ("c", True)
    assert not again.knows("c")
    again.close()
