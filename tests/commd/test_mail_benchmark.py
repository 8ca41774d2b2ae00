"""The benchmark of the mail runs, and its figures are of what it says: no threshold is asserted here."""

from __future__ import annotations

from benchmarks.mail.part import blocks, goals, measure
from benchmarks.results import here


def test_the_benchmark_of_the_mail_measures_each_row_and_writes_its_block() -> None:
    figures = measure(True)
    assert figures.rate_full > 0
    assert figures.rate_normal > 0
    assert figures.latency_full.count == figures.latency_normal.count == 20
    assert figures.memory.queued > figures.memory.bare > 0
    assert figures.talk.rate > 0
    page = blocks(here("make bench", 0.0), figures)["mail"]
    assert f"| 3,000 messages/s | {figures.rate_full:,.0f} |" in page
    assert [goal.met for goal in goals(figures)][:2] == [figures.rate_full >= 3000, figures.rate_normal >= 3000]
