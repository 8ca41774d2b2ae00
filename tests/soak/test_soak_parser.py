"""The long run of the fuzzer: it goes on where it was stopped, and reports what it did beside the other soak tests."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.soak import parser as soak_parser
from tests.soak import report as soak_report


@pytest.fixture
def report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Where the report goes instead of docs/measurements/soak.md; the run is small and keeps its state in a folder of
    the test."""
    written: list[list[str]] = []
    monkeypatch.setattr(soak_parser, "STATE", tmp_path / "state")
    monkeypatch.setattr(soak_parser, "CHUNK", 20)
    monkeypatch.setattr(soak_parser, "write_section", lambda title, lines: written.append(lines))
    return written


def test_a_run_reports_how_many_inputs_were_read_and_refused(report: list[list[str]], tmp_path: Path) -> None:
    assert soak_parser.run(seed=5, inputs=40, jobs=1) == 0
    ((head, *_),) = report
    assert "**40 inputs** of seed 5" in head
    assert "**0 failures**" in head
    assert not (tmp_path / "state").exists()


def test_a_run_that_was_stopped_goes_on_where_it_was(report: list[list[str]], tmp_path: Path) -> None:
    found = {"read": 7, "refused": 13, "characters": 900}
    failure = {"number": 3, "what": "ValueError: made up", "where": "somewhere.py:1"}
    kept = {"seed": 5, "begin": 0, "end": 20, "found": found, "failures": [failure], "seconds": 1.0}
    (tmp_path / "state").write_text(json.dumps(kept) + "\n")
    assert soak_parser.run(seed=5, inputs=40, jobs=1) == 1
    lines = report[0]
    assert "**40 inputs** of seed 5" in lines[0]
    assert "**1 failure**" in lines[0]
    assert "- input 3: `ValueError: made up` (somewhere.py:1)" in lines


def test_a_section_takes_the_place_of_the_one_before_and_leaves_the_others(tmp_path: Path) -> None:
    path = tmp_path / "soak.md"
    soak_report.write_section("Flights", ["ten"], path)
    soak_report.write_section("Parser", ["a thousand"], path)
    soak_report.write_section("Flights", ["eleven"], path)
    text = path.read_text(encoding="utf-8")
    assert text.count("## ") == 2
    assert "ten" not in text
    assert text.index("eleven") < text.index("a thousand")
