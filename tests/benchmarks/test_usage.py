"""What the paper's experiments used: how samples become rows, and rows goals."""

from __future__ import annotations

from pathlib import Path

import pytest

from argosy.processes.simulators import servo_log
from benchmarks import results
from benchmarks.flights import RESCUE, SINGLE, Flight, setup_in
from benchmarks.measurements import usage
from benchmarks.measurements.usage import AGENT, ALL, BOARD, Figures, Sampled, goals
from benchmarks.measurements.usage import usage as usage_of
from benchmarks.processes import BenchmarkFailed, Sample, Sampler

SPEED = 10.0


def told(cpu: float, rss: float) -> Sampled:
    """A flight of one board with one process, sampled once."""
    key = ("local", AGENT)
    return 10.0, [Sample(10.0, {key: cpu / 10}, {key: cpu}, {key: rss}, {key: rss})]


def pairs(*found: tuple[Sampled, Sampled]) -> Figures:
    """Figures of so many pairs: agents, programs."""
    agents, programs = zip(*found, strict=True)
    return Figures(
        [usage_of(SINGLE, SPEED, "agentspeak", list(agents)), usage_of(SINGLE, SPEED, "python", list(programs))]
    )


def test_a_ratio_above_its_goal_is_missed_with_its_figures_and_what_was_tried() -> None:
    assert [goal.met for goal in goals(pairs((told(0.94, 105), told(1, 100))))] == [True, True]
    board, agent = goals(pairs((told(1.05, 120), told(1, 100))))
    assert (board.met, board.decided, agent.met) == (False, True, True)
    assert board.found == "RSS 1.20x, CPU 1.05x; of one pair of flights"
    assert "120.0 beside 100.0 MB" in board.why
    assert "Tried: no modules" in board.why
    _, agent = goals(pairs((told(1.6, 100), told(1, 100)), (told(1.7, 100), told(1, 100))))
    assert not agent.met
    assert agent.found == "RSS 1.00x (1.00x, 1.00x), CPU 1.65x (1.60x, 1.70x)"
    assert "1.65 beside 1.00 % of a core" in agent.why
    assert "6446a99" in agent.why


def test_a_single_pair_decides_nothing_close_to_the_goal() -> None:
    for cpu in (1.0, 1.07):
        board, agent = goals(pairs((told(cpu, 100), told(1, 100))))
        assert (board.met, board.decided, agent.met) == (False, False, True)
        assert board.why.startswith(f"CPU of one pair, {cpu:.2f}x, within 10% of what is asked")
    assert goals(pairs((told(1.3, 100), told(1, 100))))[0].decided


def test_a_goal_with_pairs_on_both_sides_is_not_decided() -> None:
    board, agent = goals(pairs((told(0.9, 100), told(1, 100)), (told(1.2, 100), told(1, 100))))
    assert (board.met, board.decided) == (False, False), "1.05x in the mean, but by chance"
    assert board.why.startswith("CPU of the pairs 0.90x to 1.20x")
    assert agent.met
    found = goals(pairs((told(0.9, 150), told(1, 100)), (told(1.2, 150), told(1, 100))))[0]
    assert (found.met, found.decided) == (False, True), "its memory is above in each pair"


def test_a_mean_is_the_time_that_was_spent_and_not_that_of_the_samples_which_came() -> None:
    key = ("local", AGENT)
    late = [Sample(at, {key: spent}, {key: cpu}, {key: 1.0}, {key: 1.0}) for at, spent, cpu in ((1, 1, 100), (9, 1, 0))]
    row = usage_of(SINGLE, 1.0, "python", [(9.0, late)]).row(AGENT)
    assert row.cpu.mean == pytest.approx(100 / 9, abs=0.001)
    assert (row.cpu.std, row.cpu.max) == (50, 100)


def test_samples_of_several_boards_are_pooled_as_in_the_papers_table() -> None:
    def sample(at: float, one: float, other: float) -> Sample:
        values = {("pi1", AGENT): one, ("pi1", "commd"): 1.0, ("pi2", AGENT): other, ("pi2", "commd"): 1.0}
        return Sample(at, {key: at / 100 * value for key, value in values.items()}, values, values, values)

    found = usage_of(RESCUE, 1.0, "python", [(2.0, [sample(1.0, 1.0, 3.0), sample(2.0, 5.0, 7.0)])])
    assert found.row(BOARD, "pi1").rss.mean == 4.0
    assert found.row(BOARD).rss.mean == 5.0
    assert found.row(BOARD, "pi1").cpu.mean == 6.0, "what was spent up to the last sample"
    assert found.row(BOARD).cpu.mean == 7.0
    assert found.row(AGENT, ALL).cpu.max == 7.0
    assert found.row(AGENT, ALL).cpu.std == pytest.approx(5**0.5, abs=0.001)


def test_a_flight_without_enough_samples_is_no_row() -> None:
    sampler = Sampler({}, 1.0)
    sampler.samples = [Sample(float(at), {}, {}, {}, {}) for at in range(1, 11)]
    assert len(sampler.until(10.5, 0.9)) == 10
    assert len(sampler.until(7.5, 0.9)) == 7, "those behind the end of the flight do not count"
    with pytest.raises(BenchmarkFailed, match="only 10 samples of 20"):
        sampler.until(20.0, 0.9)


def test_a_rescue_that_the_referee_does_not_accept_is_no_row(tmp_path: Path) -> None:
    setup = setup_in(tmp_path, RESCUE.mission, SPEED)
    assert setup.logs is not None
    for robot in setup.mission.robots:
        servo_log(setup.logs, robot).touch()
    with pytest.raises(BenchmarkFailed, match="0 of 8 victims"):
        Flight(RESCUE, "python", setup, {}).until_done()


def test_a_flight_that_is_not_done_is_flown_once_more_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    course: list[Sampled | BenchmarkFailed] = []

    def fly(*_: object) -> Sampled:
        found = course.pop(0)
        if isinstance(found, BenchmarkFailed):
            raise found
        return found

    values = {("local", who): 1.0 for who in ("commd", "bridged", AGENT)}
    done = (1.0, [Sample(1.0, values, values, values, values)])
    lost = BenchmarkFailed("single UAV: the copter was late\nin lines; last:\nwords")
    monkeypatch.setattr(usage, "flown", fly)
    monkeypatch.setattr(usage, "QUICK", ((SINGLE, 1.0, 1),))
    course += [lost, done, done]
    found = usage.measure(True)
    assert [one.again for one in found.usages] == [["single UAV: the copter was late"], []]
    text = usage.blocks(results.here("a test", 0.0), found)["paper-usage"]
    assert "AgentSpeak at speed 1 1 of 2 (single UAV: the copter was late), Python at speed 1 0 of 1." in text
    assert usage.goals(found)[0].found.endswith("; flights lost: 1 of 2 of the agents")
    course += [lost, lost]
    with pytest.raises(BenchmarkFailed, match="late"):
        usage.measure(True)
