"""Texts for people: lengths of time, sizes, counts, lists, columns."""

import json
import math

import pytest

from schemas.humanize import columns, count, escaped, joined, json_lines, latency, shortened, size, span


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (-1.0, "0.0 s"),
        (0.04, "0.0 s"),
        (9.94, "9.9 s"),
        (9.96, "10 s"),
        (119.4, "119 s"),
        (119.6, "2 min"),
        (185.0, "3 min 5 s"),
        (3599.6, "1 h"),
        (7500.0, "2 h 5 min"),
        (47 * 3600.0, "47 h"),
        (74 * 3600.0, "3 d 2 h"),
        (math.inf, "? s"),
        (math.nan, "? s"),
    ],
)
def test_a_length_of_time_has_one_or_two_units(seconds: float, text: str) -> None:
    assert span(seconds) == text


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.0, "0.0 ms"), (0.00035, "0.3 ms"), (0.0994, "99.4 ms"), (0.25, "0.2 s")]
)
def test_a_short_delay_is_in_milliseconds(seconds: float, text: str) -> None:
    assert latency(seconds) == text


@pytest.mark.parametrize(
    ("number", "text"), [(999, "999 B"), (1500, "1.5 kB"), (2_000_000, "2.0 MB"), (3e9, "3.0 GB"), (4e12, "4000.0 GB")]
)
def test_a_size_has_the_unit_that_keeps_it_short(number: float, text: str) -> None:
    assert size(int(number)) == text


def test_a_noun_agrees_with_its_number() -> None:
    assert [count(number, "batch", "batches") for number in (0, 1, 2)] == ["0 batches", "1 batch", "2 batches"]
    assert count(3, "plan") == "3 plans"


def test_a_list_has_its_conjunction_before_the_last_part() -> None:
    assert [joined([]), joined(["a"]), joined("ab"), joined("abc", "or")] == ["", "a", "a and b", "a, b or c"]


def test_a_text_is_cut_at_its_bound_and_cannot_command_a_terminal() -> None:
    assert shortened("a\nb\x1b[31m", 20) == "a b [31m"
    assert shortened("abcdef", 6) == "abcdef"
    assert shortened("abcdefg", 6) == "abcde…"


def test_columns_stand_below_each_other() -> None:
    rows = [("a", "10", "x"), ("bbb", "5", "")]
    assert columns(rows, right={1}) == ["a    10  x", "bbb   5"]
    assert columns([]) == []


def test_json_stays_the_same_json_and_cannot_command_a_terminal() -> None:
    value = {"text": "a\x1b[31m\u2028é"}
    assert json.loads(json_lines(value)) == value
    assert json_lines(value).replace("\n", "").isprintable()
    assert escaped("é") == "é"
