"""Figures of the benchmarks are computed as their pages say: spreads, fits, intervals, ratios, means, verdicts."""

import math
import random
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import results
from benchmarks import spread as fits
from benchmarks.earlier import PAIRS, Costs, cost_rows, run_probe
from benchmarks.earlier import Figures as Compared
from benchmarks.earlier import goals as compared_goals
from benchmarks.flights import RESCUE, SINGLE
from benchmarks.health import Records, errors, gaps, grown, late
from benchmarks.measurements.loop import Flood, Turns, fastest, times
from benchmarks.measurements.usage import AGENT, ALL, BOARD, Figures, goals
from benchmarks.measurements.usage import usage as usage_of
from benchmarks.parts import PARTS
from benchmarks.processes import BenchmarkFailed, Sample, Sampler, Speeds
from benchmarks.reasoner.report import Result, ahead, cold, warm
from benchmarks.reasoner.rows import ROWS
from benchmarks.spread import Interval, Spread, interval, spread
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import Health


def test_a_spread_tells_where_values_lie() -> None:
    assert spread([float(value) for value in range(200, 0, -1)]) == Spread(200, 100.5, 101, 199, 200)
    assert spread([3.0]) == Spread(1, 3, 3, 3, 3)
    with pytest.raises(ValueError, match="no values"):
        spread([])


def test_lines_and_powers_are_found_again() -> None:
    line = fits.line([(size, 3.0 + 0.5 * size) for size in (1, 10, 50, 100)])
    assert (line.base, line.each) == (pytest.approx(3.0), pytest.approx(0.5))
    steep = fits.power([(size, 3.0 + size**1.5) for size in (1, 10, 50, 100)])
    assert (steep.power, steep.off, steep.reaches(1003.0)) == (1.5, pytest.approx(0.0, abs=1e-6), pytest.approx(100.0))
    flat = fits.power([(1, 1.0), (10, 0.9), (100, 1.1), (1000, 1.0)])
    assert (flat.power, flat.reaches(2.0)) == (0.0, math.inf)
    noise = random.Random(1)
    for power in (1.0, 2.0) * 20:
        points = [(size, (1 + 0.01 * size**power) * noise.uniform(0.9, 1.1)) for size in (1, 10, 100, 300, 1000)]
        assert fits.power(points).power == pytest.approx(power, abs=0.25), "noise makes no power of a line"


def test_an_interval_holds_the_true_median_nineteen_times_of_twenty() -> None:
    chance, held = random.Random(1), 0
    for _ in range(400):
        found = interval([chance.gauss(1.0, 5.0) for _ in range(40)])
        held += found.low <= 1.0 <= found.high
    assert 0.93 * 400 < held < 400
    assert interval([3.0, 1.0, 2.0]) == Interval(1.0, 2.0, 3.0, 3), "of few, from the least to the greatest"
    assert interval([5.0] * 9).plus(Interval(1, 2, 3, 4)) == Interval(6, 7, 8, 4)


def test_a_turn_of_the_loop_is_compared_with_the_bare_exchanges_that_it_contains() -> None:
    turns = Turns(put=[100.0] * 3, ask=[200.0] * 3, pong=[900.0] * 3, seen=[1800.0] * 3, status=[900.0] * 3)
    assert times(turns) == pytest.approx(1800 / (1.5 * 100 + 1.5 * 200))
    assert times(turns, ways="pong") == pytest.approx(900 / (1.5 * 100 + 0.5 * 200))
    apart = Turns(put=[100.0] * 49 + [900.0], ask=[900.0] + [100.0] * 49, seen=[3000.0] * 50)
    assert times(apart, 1.0) == pytest.approx(3000 / (1.5 * (900 + 100))), "two worst cases of different turns"


def test_a_rate_counts_only_when_nothing_was_lost_and_the_sender_reached_it() -> None:
    flood = Flood(rate=1050.0, reached=1049.0, changes=500, heard=500, behind=0.1, cpu={"agentd": 9.0})
    lost = replace(flood, rate=2000.0, reached=1990.0, heard=499, lost={"bridged bot: drops": 1.0})
    assert fastest([flood, lost]) == flood
    assert fastest([lost]) is None
    assert not replace(flood, reached=800.0).kept_up


def test_ratios_of_reasoners_are_taken_between_neighbours() -> None:
    ours = [Speeds((300.0, 1300.0), 20.0), Speeds((600.0, 2600.0), 20.0), Speeds((300.0, 1000.0), 20.0)]
    theirs = [Speeds((100.0, 100.0), 40.0), Speeds((200.0, 200.0), 40.0), Speeds((100.0, 100.0), 40.0)]
    result = Result("a", {"agentd": ours, "agentspeak": theirs})
    assert (result.ratio("agentd", cold), result.ratio("agentd", warm)) == (3.0, 8.0)
    rows = [
        Result(row.key, {"agentd": [Speeds((speed, speed), 20.0)], "agentspeak": [Speeds((10.0, 10.0), 20.0)]})
        for row in ROWS
        for speed in [110.0 if row.key == "a" else 5000.0]
    ]
    assert ahead(rows) == (11, 12, "a 11.0x where Jason has 14.4x")
    assert all(path.is_file() for row in ROWS for _, path in row.paths())


@pytest.mark.parametrize(
    ("now", "met", "decided"),
    [([104.0, 90.0, 104.9], True, True), ([106.0, 107.0, 120.0], False, True), ([100.0, 106.0, 120.0], False, False)],
)
def test_a_cost_may_be_five_per_cent_more_than_in_a_revision_before(now: list[float], met: bool, decided: bool) -> None:
    figures = Compared(probes={"mail": {"a (ms)": Costs([100.0] * 3, now), "b (MB)": Costs([10.0] * 3, [9.0] * 3)}})
    (goal,) = compared_goals(figures)
    assert (goal.met, goal.decided) == (met, decided)
    assert "| mail: b (MB) | 10 | 9 | 0.900 (0.900 to 0.900) |" in cost_rows(figures)[-1]
    assert PAIRS.keys() == {part.name for part in PARTS if hasattr(part.module(), "probe")}


PROBE = """
import subprocess, sys
code = "import agentd, os; print('FOUND', '{\\"own\\": %d}' % agentd.__file__.startswith(os.getcwd()))"
subprocess.run([sys.executable, "-P", "-c", code], check=True)
"""
"""Starts a Python as the product starts daemons: without its folder on the path."""


def test_a_probe_runs_the_product_of_its_tree(tmp_path: Path) -> None:
    for file, text in (("agentd/__init__.py", ""), ("benchmarks/__init__.py", ""), ("benchmarks/apart.py", PROBE)):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
    assert run_probe(tmp_path, "bridge", True) == {"own": 1}


Flown = tuple[float, list[Sample]]


def _flown(cpu: float, rss: float) -> Flown:
    """A flight of one board with one process, sampled once."""
    key = ("local", AGENT)
    return 10.0, [Sample(10.0, {key: cpu / 10}, {key: cpu}, {key: rss}, {key: rss})]


@pytest.mark.parametrize(
    ("agents", "board", "agent"),
    [
        ([_flown(0.94, 105)], (True, True), True),
        ([_flown(1.05, 120)], (False, True), True),
        ([_flown(1.0, 100)], (False, False), True),
        ([_flown(1.3, 100)], (False, True), False),
        ([_flown(1.6, 100), _flown(1.7, 100)], (False, True), False),
        ([_flown(0.9, 100), _flown(1.2, 100)], (False, False), True),
        ([_flown(0.9, 150), _flown(1.2, 150)], (False, True), False),
    ],
    ids=["below", "above in memory", "one pair, close", "one pair, far", "above in cpu", "both sides", "each above"],
)
def test_pairs_that_agree_decide_a_goal_of_usage(agents: list[Flown], board: tuple[bool, bool], agent: bool) -> None:
    programs = [_flown(1, 100) for _ in agents]
    figures = Figures([usage_of(SINGLE, 10.0, "agentspeak", agents), usage_of(SINGLE, 10.0, "python", programs)])
    of_board, of_agent = goals(figures)
    assert ((of_board.met, of_board.decided), of_agent.met) == (board, agent)
    assert all(one.why for one in (of_board, of_agent) if not one.met)


def test_a_mean_is_the_time_that_was_spent_and_not_that_of_the_samples_which_came() -> None:
    key = ("local", AGENT)
    uneven = [
        Sample(at, {key: spent}, {key: cpu}, {key: 1.0}, {key: 1.0}) for at, spent, cpu in ((1, 1, 100), (9, 1, 0))
    ]
    row = usage_of(SINGLE, 1.0, "python", [(9.0, uneven)]).row(AGENT)
    assert row.cpu.mean == pytest.approx(100 / 9, abs=0.001)
    assert (row.cpu.std, row.cpu.max) == (50, 100)


def test_samples_of_several_boards_are_pooled_as_in_the_papers_table() -> None:
    def sample(at: float, one: float, other: float) -> Sample:
        values = {("pi1", AGENT): one, ("pi1", "commd"): 1.0, ("pi2", AGENT): other, ("pi2", "commd"): 1.0}
        return Sample(at, {key: at / 100 * value for key, value in values.items()}, values, values, values)

    found = usage_of(RESCUE, 1.0, "python", [(2.0, [sample(1.0, 1.0, 3.0), sample(2.0, 5.0, 7.0)])])
    assert (found.row(BOARD, "pi1").rss.mean, found.row(BOARD).rss.mean) == (4.0, 5.0)
    assert (found.row(BOARD, "pi1").cpu.mean, found.row(BOARD).cpu.mean) == (6.0, 7.0), "up to the last sample"
    assert (found.row(AGENT, ALL).cpu.max, found.row(AGENT, ALL).cpu.std) == (7.0, pytest.approx(5**0.5, abs=0.001))


def test_a_flight_without_enough_samples_is_no_row() -> None:
    sampler = Sampler({}, 1.0)
    sampler.samples = [Sample(float(at), {}, {}, {}, {}) for at in range(1, 11)]
    assert len(sampler.until(7.5, 0.9)) == 7, "those behind the end of the flight do not count"
    with pytest.raises(BenchmarkFailed, match="only 10 samples of 20"):
        sampler.until(20.0, 0.9)


def test_daemons_that_tell_nothing_are_late_and_what_is_lost_at_the_edges_counts() -> None:
    def records(*reported: tuple[float, str, Health]) -> Records:
        bytes_of = codec(Health).encode
        return Records([(at, keys.health("f", name, one.daemon), bytes_of(one, "json")) for at, name, one in reported])

    assert late(Records(), 0.0, 12.0) == 3
    assert grown(Records(), 0.0, 12.0)["agentd"].counts["drops"] == 0
    first, last = (
        Health(daemon="bridged", pid=7, drops=drops, errors=drops, percepts={"a": f"boot:{seq}:00"})
        for drops, seq in ((1, 10), (4, 130))
    )
    reported = records((9.0, "u", first), (21.0, "u", last), (9.0, "v", first), (21.0, "v", last))
    found = grown(reported, 10.0, 20.0)["bridged"]
    assert found.counts["drops"] == 6, "between the last record before and the first behind"
    assert found.rates["percepts"] == pytest.approx(20.0)
    assert errors(reported, 10.0, 20.0) == 3, "one process logs what both names tell"
    assert late(reported, 10.0, 20.0) == 4, "neither said anything meanwhile, and commd and agentd nothing at all"
    heard: list[list[float]] = [[], [float(at) for at in range(11)], [1.0, 2.0, 3.0, 4.0]]
    assert [gaps(one, 0.0, 10.0, 1.5) for one in heard] == [1, 0, 1]


def _git(root: Path, *arguments: str) -> None:
    who = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
    subprocess.run(["git", *who, *arguments], cwd=root, check=True, capture_output=True)


def _commit(root: Path, file: str) -> str:
    (root / file).parent.mkdir(parents=True, exist_ok=True)
    (root / file).write_text(file)
    _git(root, "add", ".")
    _git(root, "commit", "-qm", file)
    return results.revision(root)


def test_code_that_is_new_or_changes_while_it_is_measured_belongs_to_no_revision(tmp_path: Path) -> None:
    assert results.revision(tmp_path) == "unknown"
    _git(tmp_path, "init", "-q")
    first = _commit(tmp_path, "agentd/a.py")
    assert re.fullmatch("[0-9a-f]{7}", first)
    page = _commit(tmp_path, "docs/page.md")
    assert results.measured_revision(first, page, tmp_path) == first, "a page is no code"
    (tmp_path / "benchmarks" / "results").mkdir(parents=True)
    (tmp_path / "benchmarks" / "results" / "mail.json").write_text("{}")
    assert results.revision(tmp_path) == page, "nor are results"
    (tmp_path / "benchmarks" / "new.asl").write_text("!a.")
    assert results.revision(tmp_path) == f"{page}+", "a file that git does not know can be measured, too"
    code = _commit(tmp_path, "benchmarks/new.asl")
    assert results.measured_revision(page, code, tmp_path) == f"{page}+"
