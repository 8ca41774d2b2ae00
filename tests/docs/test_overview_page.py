"""docs/architecture/overview.md leads to the lines of the code that it names."""

from __future__ import annotations

import re

import pytest

from tests.docs.overview_page import PAGE, REFERENCE, written
from tests.docs.pages import ROOT

QUESTIONS = 15
"""Rows of the table that says where something is decided."""


def test_its_references_are_to_the_lines_of_the_code() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == written(page), "make reference"


def test_each_file_that_it_names_exists() -> None:
    packages = "agentd|argosy|bridged|commd|schemas"
    named = re.findall(rf"`((?:{packages})(?:/\w+)+\.py)", PAGE.read_text(encoding="utf-8"))
    assert len(named) > QUESTIONS
    assert [file for file in named if not (ROOT / file).is_file()] == []


def test_each_question_is_answered_by_one_or_more_references() -> None:
    table = PAGE.read_text(encoding="utf-8").partition("## Where is it decided?")[2].partition("\n## ")[0]
    rows = [line for line in table.splitlines() if line.startswith("| ") and not line.startswith("| Question")]
    assert len(rows) >= QUESTIONS
    assert [row for row in rows if not REFERENCE.search(row)] == []


@pytest.mark.parametrize("name", ["VehicleSession.lost", "NoSuchClass"])
def test_a_name_that_the_file_does_not_have_is_an_error(name: str) -> None:
    with pytest.raises(KeyError):
        written(f"`bridged/drivers/mavlink/session.py` (`{name}`)")


def test_a_line_that_has_moved_is_written_again() -> None:
    wrong = "`bridged/drivers/mavlink/session.py:1` (`VehicleSession._lost`)"
    assert written(wrong) != wrong
