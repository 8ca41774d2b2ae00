"""The part `looking` of the benchmarks: it lets onlookers look on, counts, and writes; no figure is judged here."""

from __future__ import annotations

import random
import time

import pytest

from benchmarks.looking.bursts import Cost, used
from benchmarks.looking.part import UNDECIDED, Figures, Share, blocks, goals, measure
from benchmarks.results import here
from benchmarks.spread import Interval, interval
from tests.support.processes import running


def test_onlookers_look_at_agents_and_listen_to_them() -> None:
    figures = measure(True)
    found = {cost.key: cost for cost in figures.costs}
    assert found.keys() == {"run", "watch", "control", "activity", "recorder"}
    assert found["run"].heard == found["watch"].heard == 1
    assert found["control"].heard == 0
    assert found["recorder"].heard >= 1
    assert all(cost.work > 0 for cost in figures.costs)
    assert figures.calm > 0
    assert [share.got for share in figures.shares] == [{}]
    page = blocks(here("make bench", 0.0), figures)["looking"]
    assert f"| {found['run'].work:.1f} ms | {found['run'].extra.told(' ms', 2)} |" in page
    assert len(goals(figures)) == 3


def _figures(extra: Interval, heard: Interval) -> Figures:
    costs = [
        Cost("run", "run", extra, 20.0, 1),
        Cost("watch", "watch", extra, 20.0, 1),
        Cost("activity", "activity", heard, 20.0, 2),
        Cost("recorder", "recorder", heard, 20.0, 3),
    ]
    nothing = Interval(0, 0, 0, 9)
    return Figures(9, 3, 2.0, 2.0, costs, nothing, nothing, 4.0, [Share("nobody", {}, 4.0, nothing)])


def test_a_loss_is_that_of_so_many_looks_and_its_whole_interval_is_held_against_the_goal() -> None:
    run, watch, ui = goals(_figures(Interval(3, 4, 9.9, 50), Interval(0.5, 1, 1.5, 50)))
    assert run.found == watch.found == "0.80 % (0.60 to 1.98)"
    assert (run.met, watch.met) == (True, True)
    assert ui.found == "1.00 % (0.70 to 2.28)"  # a record for each half of what is put four times a second
    assert (ui.met, ui.decided) == (False, False)
    assert ui.why == UNDECIDED
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


def test_the_processor_time_of_another_process_is_read_with_that_of_threads_that_have_ended() -> None:
    with running("timeit", "-n", "1", "-r", "1", "sum(range(10**12))") as other:
        end = time.monotonic() + 20
        while used(other.process.pid) < 0.2:
            assert time.monotonic() < end
            time.sleep(0.02)
        first = used(other.process.pid)
        time.sleep(0.3)
        assert used(other.process.pid) > first
