"""The table of six kinds of vehicles in docs/guides/mavlink.md is what their flights are."""

from __future__ import annotations

from tests.docs.six_kinds_page import PAGE, block, flights, written


def test_the_table_is_that_of_the_flights() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert written(page, block(flights())) == page
