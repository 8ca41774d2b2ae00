"""The decision loop is really run, its stamps are put together loop by loop, and a lost percept would be seen."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from benchmarks.loop import flood, latency, stages
from benchmarks.loop.flood import Flood
from benchmarks.loop.latency import Turns
from benchmarks.loop.page import Figures, blocks, fastest, goals, pictures, times
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import here


def test_the_loop_runs_through_the_daemons_and_each_stage_of_it_is_stamped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(latency, "WARM_UP", 10)
    found = latency.measure(5, stamped=True)
    assert len(found.put) == len(found.ask) == len(found.seen) == 5
    assert len(found.stages) == len(stages.STAGES)
    assert all(0 < pong < seen for pong, seen in zip(found.pong, found.seen, strict=True))
    assert len(found.loop) >= 3, "of a busy machine's loops some may lack a stamp, and no more"
    if len(found.loop) == 5:
        assert all(0 < loop < seen for loop, seen in zip(found.loop, found.seen, strict=True)), (
            "the plan goes on before its next action is at the robot"
        )
    quiet = [stage.stamp for stage, spent in zip(stages.STAGES, found.stages, strict=True) if not any(spent)]
    assert not quiet, "these take no time in any loop: is the stamp at its place?"


def test_each_percept_of_a_flood_makes_its_event_and_one_that_is_lost_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    put = flood.Board.put

    def forgetful(self: flood.Board, source: str, number: int, of: int = 0) -> None:
        if (source, number, of) != ("tick", 7, 20):
            put(self, source, number, of)

    monkeypatch.setattr(flood.Board, "put", forgetful)
    monkeypatch.setattr(flood, "PATIENCE", 5.0)
    whole, lacking = flood.measure([200.0, 40.0], seconds=0.5)
    assert whole.changes == whole.heard == 100
    assert not whole.disorder
    assert not whole.lost
    assert all(whole.cpu[who] >= 0 for who in ("commd", "bridged", "agentd"))
    assert (lacking.changes, lacking.heard) == (20, 19)
    assert any("came 8 instead of 7" in line for line in lacking.disorder)
    assert not lacking.complete


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
    late = {**read, "action put": [1_010_500]}  # behind what the bridge has done with it
    spent = [one for (one,) in stages.split(late, [(1_000_000, 2_000_000)])]
    assert sum(spent) == len(stamps), "no time is lost, and none counts twice"
    assert spent[stamps.index("action put")] > 1
    assert spent[stamps.index("action arrived")] == spent[stamps.index("action taken")] == 0
    assert stages.split(read, [(3_000_000, 4_000_000)]) == [[] for _ in stamps], "a loop without stamps is left out"
    with pytest.raises(BenchmarkFailed, match="no stamps of nothing"):
        stages.read([tmp_path / "nothing"])


def _figures() -> Figures:
    turns = Turns(put=[100.0] * 3, ask=[200.0] * 3, pong=[900.0] * 3, seen=[1800.0] * 3)
    stamped = replace(turns, stages=[[50.0] * 3 for _ in stages.STAGES])
    cpu = {"bridged": 9.0, "agentd": 9.0, "commd": 9.0}
    run = Flood(rate=1050.0, reached=1049.0, changes=500, heard=500, behind=0.1, cpu=cpu)
    lost = replace(run, rate=2000.0, reached=1990.0, heard=499, lost={"bridged bot: drops": 1.0})
    carried = {"sample": 1, "percept": 2, "action": 3, "status": 4}
    return Figures(carried, turns, turns, stamped, turns, [run, lost], [lost])


def test_the_loop_is_compared_with_the_bare_exchanges_that_it_contains() -> None:
    figures = _figures()
    assert times(figures.stamped) == pytest.approx(50 * len(stages.STAGES) / (100 + 200))
    assert times(figures.kept, ways="seen") == pytest.approx(1800 / (1.5 * 100 + 1.5 * 200))
    assert times(figures.kept, ways="pong") == pytest.approx(900 / (1.5 * 100 + 0.5 * 200))
    found = goals(figures)
    assert [goal.met for goal in found] == [True, False, True, False]
    assert found[1].found == "4.0 times (at p99 4.0)"
    assert all("tried: [what was made shorter]" in goal.why for goal in found if not goal.met)


def test_two_worst_cases_of_different_turns_are_not_added_up() -> None:
    turns = Turns(put=[100.0] * 49 + [900.0], ask=[900.0] + [100.0] * 49, seen=[3000.0] * 50)
    assert times(turns, 1.0, ways="seen") == pytest.approx(3000 / (1.5 * (900 + 100)))


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


def test_loops_without_all_stamps_are_told() -> None:
    figures = _figures()
    figures.stamped.stages = [[50.0] * 2 for _ in stages.STAGES]
    assert "Of 3 stamped loops 2 have all stamps" in blocks(here("make bench", 0.0), figures)["loop"]


def test_the_page_and_the_plot_are_made_of_the_figures() -> None:
    figures = msgspec.convert(msgspec.json.decode(msgspec.json.encode(_figures())), Figures)
    text = blocks(here("make bench", 0.0), figures)["loop"]
    assert "| replaced | 1,049 | 500 | 500 |" in text
    assert "bridged bot: drops 1" in text
    for stage in stages.STAGES:
        assert f"| {stage.title} | {stage.who} | 50 | 50 |" in text
    assert pictures(figures)["loop"].startswith("<?xml")
