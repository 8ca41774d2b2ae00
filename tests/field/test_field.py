"""A few rows of docs/measurements/faults.md as tests: in the order and for the reasons declared, with
patience for a busy machine."""

from pathlib import Path

import pytest

from tests.field import agents, bridges, rows
from tests.field.units import UnitFile

BUSY = 25.0
"""Seconds by which a figure may be late here; `make field` holds them to 2."""


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "MARGIN", BUSY)
    monkeypatch.setattr(agents, "MARGIN", BUSY)
    monkeypatch.setattr(rows, "EARLY", 3.0)


def test_a_function_that_hangs_in_flight_is_answered_for_and_ended_by_the_watchdog(tmp_path: Path) -> None:
    assert not bridges.board_hung(tmp_path).problems


def test_a_link_between_boards_that_is_cut_brings_the_vehicle_home(tmp_path: Path, namespaces: None) -> None:
    assert not agents.cut(tmp_path).problems


@pytest.mark.parametrize("daemon", ["commd", "bridged", "agentd", "board"])
def test_the_units_that_are_shipped_say_what_the_page_counts_with(daemon: str) -> None:
    assert UnitFile.read(daemon).watchdog == agents.WATCHDOG
