"""The benchmark of the mail runs, and its figures are of what it says: no threshold is asserted here."""

from __future__ import annotations

import argparse

from benchmarks.mail import measure
from benchmarks.mail_page import report


def test_the_benchmark_of_the_mail_measures_each_row_and_writes_its_page() -> None:
    args = argparse.Namespace(seconds=1.0, letters=20, backlog=2400, queued=2000, agents=5, tokens=20)
    figures = measure(**vars(args))
    assert all(rate > 0 for rate in figures.rates)
    assert [len(one.values) for one in figures.latencies] == [20, 20]
    assert figures.memory.queued > figures.memory.bare > 0
    assert figures.talk.rate > 0
    assert figures.crowd.presence > 0
    page = report(figures, args)
    assert f"| {figures.rates[0]:,.0f} | 3,000 |" in page
    assert "5 agents in one agentd" in page
