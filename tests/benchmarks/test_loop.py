"""The decision loop: its time against bare exchanges, and which rates count."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from benchmarks.measurements.loop import Figures, Flood, Turns, blocks, fastest, goals, times
from benchmarks.results import here


def _figures() -> Figures:
    turns = Turns(put=[100.0] * 3, ask=[200.0] * 3, pong=[900.0] * 3, seen=[1800.0] * 3, status=[900.0] * 3)
    cpu = {"bridged": 9.0, "agentd": 9.0, "commd": 9.0}
    run = Flood(rate=1050.0, reached=1049.0, changes=500, heard=500, behind=0.1, cpu=cpu)
    lost = replace(run, rate=2000.0, reached=1990.0, heard=499, lost={"bridged bot: drops": 1.0})
    carried = {"sample": 1, "percept": 2, "action": 3, "status": 4}
    return Figures(carried, turns, turns, [run, lost], [lost])


def test_the_loop_is_compared_with_the_bare_exchanges_that_it_contains() -> None:
    figures = _figures()
    assert times(figures.kept) == pytest.approx(1800 / (1.5 * 100 + 1.5 * 200))
    assert times(figures.kept, ways="pong") == pytest.approx(900 / (1.5 * 100 + 0.5 * 200))
    found = goals(figures)
    assert [goal.met for goal in found] == [False, False, True, False]
    assert found[1].found == "0.9 ms, 3.6 times"
    assert found[0].found == "4.0 times (at p99 4.0)"
    assert all("tried: " in goal.why for goal in found if not goal.met)


def test_two_worst_cases_of_different_turns_are_not_added_up() -> None:
    turns = Turns(put=[100.0] * 49 + [900.0], ask=[900.0] + [100.0] * 49, seen=[3000.0] * 50)
    assert times(turns, 1.0) == pytest.approx(3000 / (1.5 * (900 + 100)))


def test_a_rate_counts_only_when_nothing_was_lost() -> None:
    figures = _figures()
    assert fastest(figures.replaced) == figures.replaced[0]
    assert fastest(figures.added) is None


def test_a_rate_that_the_sender_did_not_reach_is_not_met() -> None:
    figures = _figures()
    slow = replace(figures.replaced[0], reached=800.0)
    assert slow.complete
    assert not slow.kept_up
    goal = goals(replace(figures, replaced=[slow]))[2]
    assert (goal.found, goal.met) == ("0", False)
    assert goal.why.startswith("of 1,050 changes a second the sender here made 800; tried: ")
    nearly = replace(figures.replaced[0], reached=999.0, rate=1010.0)
    assert goals(replace(figures, replaced=[nearly]))[2].met is False, "no more counts than was made"


def test_the_page_is_made_of_the_figures() -> None:
    figures = msgspec.convert(msgspec.json.decode(msgspec.json.encode(_figures())), Figures)
    text = blocks(here("make bench", 0.0), figures)["loop"]
    assert "| replaced | 1,049 | 500 | 500 |" in text
    assert "bridged bot: drops 1" in text
