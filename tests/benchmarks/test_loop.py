"""The decision loop is really run, its stamps are put together loop by loop, and a lost percept would be seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from benchmarks.loop import flood, latency, stages
from benchmarks.loop.flood import Flood
from benchmarks.loop.latency import Turns
from benchmarks.loop.part import Figures, blocks, fastest, goals, pictures, times
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import here


def test_the_loop_runs_through_the_daemons_and_each_stage_of_it_is_stamped() -> None:
    found = latency.measure(5, stamped=True)
    assert len(found.put) == len(found.ask) == len(found.seen) == 5
    assert len(found.stages) == len(stages.STAGES)
    assert len(found.loop) == 5, "a loop lacks a stamp"
    for loop, pong, seen in zip(found.loop, found.pong, found.seen, strict=True):
        assert 0 < pong < seen
        assert 0 < loop < seen, "the plan goes on before its next action is at the robot"
    quiet = [stage.stamp for stage, spent in zip(stages.STAGES, found.stages, strict=True) if not any(spent)]
    assert not quiet, "these take no time in any loop: is the stamp at its place?"


def test_each_percept_of_a_flood_makes_its_event() -> None:
    (found,) = flood.measure([200.0], seconds=0.5)
    assert found.changes == found.heard == 100
    assert not found.disorder
    assert not found.lost


def test_a_percept_that_is_lost_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    put = flood.Board.put

    def forgetful(self: flood.Board, source: str, number: int, of: int = 0) -> None:
        if (source, number) != ("tick", 7):
            put(self, source, number, of)

    monkeypatch.setattr(flood.Board, "put", forgetful)
    monkeypatch.setattr(flood, "PATIENCE", 5.0)
    (found,) = flood.measure([200.0], seconds=0.1)
    assert (found.changes, found.heard) == (20, 19)
    assert any("came 8 instead of 7" in line for line in found.disorder)
    assert not found.complete


def test_stages_are_split_loop_by_loop(tmp_path: Path) -> None:
    stamps = [stage.stamp for stage in stages.STAGES]
    bridge = [(stamp, 1_000_000 + 1000 * place) for place, stamp in enumerate(stamps[:4], 1)]
    agent = [(stamp, 1_000_000 + 1000 * place) for place, stamp in enumerate(stamps[4:], 5)]
    agent += [(stamp, 9_000_000) for stamp in stamps]  # of another loop
    files = {"bridged": bridge, "agentd": agent}
    for name, noted in files.items():
        (tmp_path / name).write_bytes(msgspec.json.encode(noted))
    read = stages.read(tmp_path / name for name in files)
    assert stages.split(read, [(1_000_000, 2_000_000)]) == [[1.0] for _ in stamps]
    assert stages.split(read, [(3_000_000, 4_000_000)]) == [[] for _ in stamps], "a loop without stamps is left out"
    with pytest.raises(BenchmarkFailed, match="no stamps of nothing"):
        stages.read([tmp_path / "nothing"])


def _figures() -> Figures:
    turns = Turns(put=[100.0] * 3, ask=[200.0] * 3, pong=[900.0] * 3, seen=[1800.0] * 3)
    stamped = replace(turns, stages=[[50.0] * 3 for _ in stages.STAGES])
    run = Flood(rate=1000.0, reached=999.0, changes=500, heard=500, behind=0.1, cpu={"bridged": 9.0, "agentd": 9.0})
    lost = replace(run, rate=2000.0, heard=499, lost={"bridged bot: drops": 1.0})
    return Figures({"sample": 1, "percept": 2, "action": 3, "status": 4}, turns, turns, stamped, [run, lost], [lost])


def test_the_loop_is_compared_with_the_bare_exchanges_that_it_contains() -> None:
    figures = _figures()
    assert times(figures.stamped) == pytest.approx(50 * len(stages.STAGES) / (100 + 200))
    assert times(figures.kept, ways="seen") == pytest.approx(1800 / (1.5 * 100 + 1.5 * 200))
    assert times(figures.kept, ways="pong") == pytest.approx(900 / (1.5 * 100 + 0.5 * 200))
    assert [goal.met for goal in goals(figures)] == [True, False, True, False]


def test_a_rate_counts_only_when_nothing_was_lost() -> None:
    figures = _figures()
    assert fastest(figures.replaced) == figures.replaced[0]
    assert fastest(figures.added) is None


def test_the_page_and_the_plot_are_made_of_the_figures() -> None:
    figures = msgspec.convert(msgspec.json.decode(msgspec.json.encode(_figures())), Figures)
    text = blocks(here("make bench", 0.0), figures)["loop"]
    assert "| replaced | 999 | 500 | 500 |" in text
    assert "bridged bot: drops 1" in text
    for stage in stages.STAGES:
        assert f"| {stage.title} | {stage.who} | 50 | 50 |" in text
    assert pictures(figures)["loop"].startswith("<?xml")
