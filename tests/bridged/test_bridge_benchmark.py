"""The benchmark of the bridge runs, and its figures are of what it says: no threshold is asserted here."""

from __future__ import annotations

from benchmarks.bridge import VEHICLES, blocks, goals, measure
from benchmarks.results import here


def test_the_benchmark_of_three_vehicles_measures_every_position_and_writes_its_block() -> None:
    figures = measure(True)
    assert figures.latency.count + figures.lost == VEHICLES * 20
    assert figures.lost <= VEHICLES * 10, "most positions become events"
    assert figures.rss > figures.dialect > figures.bare > 0
    assert 0 < figures.latency.p50 <= figures.latency.p99 <= figures.latency.max
    page = blocks(here("make bench", 0.0), figures)["bridge"]
    assert f"| 5 % of a core | {figures.cpu:.1f} % |" in page
    assert f"the slowest {figures.latency.max:.1f} ms, of {figures.latency.count} positions" in page
    assert next(goal.met for goal in goals(figures)) == (figures.cpu <= 5)
