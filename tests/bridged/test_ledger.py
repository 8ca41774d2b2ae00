"""The ids of the last hour outlive the bridge, whatever state the file is in."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest

from bridged.ledger import KEEP, Ledger
from schemas.records import ActionStatus


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
