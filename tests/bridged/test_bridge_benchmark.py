"""The benchmark of the bridge runs, and its figures are of what it says: no threshold is asserted here."""

from __future__ import annotations

from benchmarks.bridge import VEHICLES, measure, report


def test_the_benchmark_of_three_vehicles_measures_every_position_and_writes_its_page() -> None:
    figures = measure(2.0, warm_up=3.0)
    assert len(figures.latencies) + figures.lost == VEHICLES * 20
    assert figures.lost <= VEHICLES * 10, "most positions become events"
    assert figures.rss > figures.bare > 0
    assert figures.latencies == sorted(figures.latencies)
    page = report(figures)
    assert f"| {figures.cpu:.1f} % of a core |" in page
    assert f"| {figures.percentile(0.99):.2f} ms |" in page
