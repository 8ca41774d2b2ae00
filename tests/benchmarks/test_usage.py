"""What the paper's experiments used: flown and sampled for real, and told as it was found."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from argosy.surroundings import servo_log
from benchmarks import results
from benchmarks.flights import APPROACHES, RESCUE, SINGLE, Flight, flying, setup_in
from benchmarks.paper import usage
from benchmarks.paper.usage import ALL, BOARD, Figures
from benchmarks.parts import PARTS
from benchmarks.processes import BenchmarkFailed
from benchmarks.sampling import AGENT, Sample

SPEED = 10.0


@pytest.fixture(scope="module")
def flown() -> Figures:
    """The single-UAV mission, flown once by each approach."""
    figures = Figures()
    for approach in APPROACHES:
        taken, samples = usage.flown(SINGLE, approach, SPEED, 0.25)
        figures.usages.append(usage.usage(SINGLE, SPEED, approach, [(taken, samples)]))
        figures.drawn.append(usage.drawn(SINGLE, SPEED, approach, samples))
    return figures


@pytest.mark.parametrize("approach", APPROACHES)
def test_each_daemon_of_the_board_is_sampled_until_the_mission_is_done(flown: Figures, approach: str) -> None:
    found = flown.of(SINGLE.mission, SPEED, approach)
    assert found.seconds[0] * SPEED > 60, "the mission takes longer"
    assert found.samples > 8
    for who in ("commd", "bridged", AGENT):
        row = found.row(who)
        assert row.rss.mean > row.pss.mean > 5, "MB of a Python process with a session"
        assert row.cpu.max >= row.cpu.mean > 0


@pytest.mark.parametrize("approach", APPROACHES)
def test_a_board_is_the_sum_of_its_daemons_without_simulators(flown: Figures, approach: str) -> None:
    found = flown.of(SINGLE.mission, SPEED, approach)
    daemons = [found.row(who) for who in ("commd", "bridged", AGENT)]
    assert found.row(BOARD).rss.mean == pytest.approx(sum(one.rss.mean for one in daemons), abs=0.01)
    assert found.row(BOARD).cpu.mean == pytest.approx(sum(one.cpu.mean for one in daemons), abs=0.01)


def test_what_was_found_is_told_beside_the_papers_figures(flown: Figures) -> None:
    again = msgspec.json.decode(msgspec.json.encode(flown), type=Figures)
    text = usage.blocks(results.here("a test", 0.0), again)["paper-usage"]
    assert "| the only one | the paper's Jason | 1 | 16.88 |" in text  # table 3: 4.22 % of four cores
    mine = flown.of(SINGLE.mission, SPEED, "agentspeak").row(BOARD)
    assert f"| the only one | **AgentSpeak** | {SPEED:g} | {mine.cpu.mean:.2f} |" in text
    assert set(usage.pictures(again)) == {"usage-single", "usage-ratios"}


def test_a_ratio_above_its_goal_is_missed_with_its_figures(flown: Figures) -> None:
    figures = msgspec.json.decode(msgspec.json.encode(flown), type=Figures)
    theirs = figures.of(SINGLE.mission, SPEED, "python")
    for row in figures.of(SINGLE.mission, SPEED, "agentspeak").rows:
        its = theirs.row(row.who, row.board)
        row.rss.mean, row.cpu.mean = 1.05 * its.rss.mean, 1.05 * its.cpu.mean
    figures.of(SINGLE.mission, SPEED, "agentspeak").alone = theirs.alone
    assert [goal.met for goal in usage.goals(figures)] == [True, True]
    figures.of(SINGLE.mission, SPEED, "agentspeak").row(BOARD).rss.mean *= 1.1
    board, agent = usage.goals(figures)
    assert (board.met, agent.met) == (False, True)
    assert "RSS 1.16x" in board.found or "RSS 1.15x" in board.found
    assert "MB" in board.why


def test_samples_of_several_boards_are_pooled_as_in_the_papers_table() -> None:
    def sample(one: float, other: float) -> Sample:
        values = {("pi1", AGENT): one, ("pi1", "commd"): 1.0, ("pi2", AGENT): other, ("pi2", "commd"): 1.0}
        return Sample(1.0, values, values, values)

    found = usage.usage(RESCUE, 1.0, "python", [(2.0, [sample(1.0, 3.0), sample(5.0, 7.0)])])
    assert found.row(BOARD, "pi1").cpu.mean == 4.0
    assert found.row(BOARD).cpu.mean == 5.0
    assert found.row(AGENT, ALL).cpu.max == 7.0
    assert found.row(AGENT, ALL).cpu.std == pytest.approx(5**0.5, abs=0.001)


def test_a_rescue_that_the_referee_does_not_accept_is_no_row(tmp_path: Path) -> None:
    setup = setup_in(tmp_path, RESCUE.mission, SPEED)
    assert setup.logs is not None
    for robot in setup.mission.robots:
        servo_log(setup.logs, robot).touch()
    with pytest.raises(BenchmarkFailed, match="0 of 8 victims"):
        Flight(RESCUE, "python", setup, {}).until_done()


def test_a_mission_that_is_not_done_in_time_is_no_row() -> None:
    with flying(SINGLE, "python", SPEED) as flight, pytest.raises(BenchmarkFailed, match="not done after"):
        flight.until_done(patience=0.1)
    assert all(watched.process.returncode is not None for _, watched in flight.watched), "nothing is left behind"


def test_a_flight_that_is_not_done_is_flown_once_more_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    course: list[tuple[float, list[Sample]] | BenchmarkFailed] = []

    def fly(*_: object) -> tuple[float, list[Sample]]:
        found = course.pop(0)
        if isinstance(found, BenchmarkFailed):
            raise found
        return found

    values = {("local", who): 1.0 for who in ("commd", "bridged", AGENT)}
    done = (1.0, [Sample(1.0, values, values, values)])
    lost = BenchmarkFailed("single UAV: the copter was late; last:\nwords")
    monkeypatch.setattr(usage, "flown", fly)
    monkeypatch.setattr(usage, "QUICK", ((SINGLE, 1.0, 1),))
    course += [lost, done, done]
    found = usage.measure(True)
    assert [one.again for one in found.usages] == [["single UAV: the copter was late"], []]
    assert (
        "flown again: single UAV: the copter was late"
        in usage.blocks(results.here("a test", 0.0), found)["paper-usage"]
    )
    course += [lost, lost]
    with pytest.raises(BenchmarkFailed, match="late"):
        usage.measure(True)


def test_it_is_a_part_of_the_benchmarks() -> None:
    assert "usage" in [part.name for part in PARTS]
