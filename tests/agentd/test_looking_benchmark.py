"""`make bench-looking`: it lets onlookers look on, counts, and writes; no figure is judged here."""

from __future__ import annotations

from collections import Counter

import pytest

from agentd.look import Look
from benchmarks import looking, one_look
from benchmarks.looking import Figures, busy, report
from benchmarks.onlookers import NOBODY, ONLOOKERS, Stretch
from benchmarks.processes import BenchmarkFailed


def test_onlookers_look_at_a_busy_agent_and_listen_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looking, "ONLOOKERS", [one for one in ONLOOKERS if one.key == "ui"])
    (ui,) = busy(1, 2.5)
    ((one, neighbours),) = ui.pairs
    assert all(stretch.cycles > 0 and stretch.cpu > 0 and stretch.wall > 0 for stretch in (one, *neighbours))
    assert one.got["looks"] >= 1
    assert one.got["deeds"] >= 1
    assert one.got["errors"] == 0
    assert neighbours[0].got == Counter()


def test_one_look_is_measured_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(one_look, "LOOKS", 3)
    monkeypatch.setattr(one_look, "BETWEEN", 0.01)
    assert one_look.one_look(looking._BUSY, Look()) > 0


def test_a_loss_is_told_against_its_neighbours_and_held_against_the_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(looking, "one_look", lambda program, look: 4.0)

    def figures(onlooker: looking.Onlooker, cycles: float, looks: int = 8) -> Figures:
        one = Stretch(cycles, 1.0, 2.0, 4.0, Counter(looks=looks))
        return Figures(onlooker, [(one, (Stretch(1000, 1.0, 2.0, 4.0, Counter()),) * 2)] * 3)

    watch = next(one for one in ONLOOKERS if one.key == "watch")
    page = report([figures(NOBODY, 1000, 0), figures(watch, 970)], [figures(watch, 10)], 4.0)
    assert "| 2.0 looks/s | 4.0 ms: 0.8 % at 2 Hz | 3.0 % (3.0 to 3.0) | 3.0 % (3.0 to 3.0) | missed |" in page
    assert "| nobody | nothing |  | 0.0 % (0.0 to 0.0) | 0.0 % (0.0 to 0.0) |  |" in page
    failed = Figures(
        watch, [(Stretch(1, 1.0, 1.0, 1.0, Counter(errors=2)), (Stretch(1, 1.0, 1.0, 1.0, Counter()),) * 2)]
    )
    with pytest.raises(BenchmarkFailed, match="2 looks of watch were not answered"):
        failed.looks()
