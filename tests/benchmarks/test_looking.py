"""The part "looking": what a busy agent loses, and the interval that is held against the goal."""

from __future__ import annotations

import random

import pytest

from benchmarks.measurements.looking import Cost, Figures, blocks, goals
from benchmarks.results import here
from benchmarks.spread import Interval, interval


def _figures(extra: Interval, heard: Interval) -> Figures:
    return Figures([
        Cost("run", "run", extra, 20.0, 1),
        Cost("watch", "watch", extra, 20.0, 1),
        Cost("activity", "activity", heard, 20.0, 2),
        Cost("recorder", "recorder", heard, 20.0, 3),
    ])  # fmt: skip


def test_a_loss_is_that_of_so_many_looks_and_its_whole_interval_is_held_against_the_goal() -> None:
    run, watch, ui = goals(_figures(Interval(3, 4, 9.9, 50), Interval(0.5, 1, 1.5, 50)))
    assert run.found == watch.found == "0.80 % (0.60 to 1.98)"
    assert (run.met, watch.met) == (True, True)
    assert ui.found == "1.00 % (0.70 to 2.28)"  # a record for each half of what is put four times a second
    assert (ui.met, ui.decided) == (False, False)
    assert ui.why.startswith("the interval holds the goal")
    missed = goals(_figures(Interval(11, 12, 13, 50), Interval(0, 0, 0, 50)))[0]
    assert (missed.met, missed.decided) == (False, True)
    assert "tried: `argosy run` asks for no more than it shows" in missed.why


def test_what_hears_decisions_grows_with_the_work() -> None:
    page = blocks(here("make bench", 0.0), _figures(Interval(3, 4, 5, 50), Interval(1, 2, 3, 50)))["looking"]
    assert "| recorder | 50 | 20.0 ms | 2.00 ms (1.00 to 3.00) | 10.00 % (5.00 to 15.00) |" in page


def test_an_interval_holds_the_true_median_nineteen_times_of_twenty() -> None:
    chance = random.Random(1)
    held = 0
    for _ in range(400):
        found = interval([chance.gauss(1.0, 5.0) for _ in range(40)])
        assert found.low <= found.median <= found.high
        held += found.low <= 1.0 <= found.high
    assert 0.93 * 400 < held < 400


def test_an_interval_of_few_is_from_the_least_to_the_greatest() -> None:
    assert interval([3.0, 1.0, 2.0]) == Interval(1.0, 2.0, 3.0, 3)
    with pytest.raises(ValueError, match="no differences"):
        interval([])
    assert interval([5.0] * 9).plus(Interval(1, 2, 3, 4)) == Interval(6, 7, 8, 4)
