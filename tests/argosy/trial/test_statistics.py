"""Shares and intervals, the difference of two missions, causes, distributions."""

import pytest

from argosy.trial.checkers import Violation
from argosy.trial.faults import BoardDown, Kill, Vehicle
from argosy.trial.single_run import Outcome
from argosy.trial.statistics import (
    FaultShare,
    causes,
    distributions,
    fault_shares,
    histogram,
    mcnemar,
    quantiles,
    same_cause,
    wilson,
)


@pytest.mark.parametrize(
    ("successes", "runs", "low", "high"),
    [
        (20, 20, 0.839, 1.0),
        (50, 50, 0.929, 1.0),
        (100, 100, 0.963, 1.0),
        (1000, 1000, 0.996, 1.0),
        (95, 100, 0.888, 0.978),
        (990, 1000, 0.982, 0.995),
        (9900, 10000, 0.988, 0.992),
        (0, 20, 0.0, 0.161),
        (1, 1, 0.207, 1.0),
    ],
)
def test_the_wilson_interval_has_the_values_of_the_tables(successes: int, runs: int, low: float, high: float) -> None:
    found = wilson(successes, runs)
    assert found.share == successes / runs
    assert (round(found.low, 3), round(found.high, 3)) == (low, high)


def test_no_runs_have_no_share() -> None:
    with pytest.raises(ValueError, match="no runs"):
        wilson(0, 0)


@pytest.mark.parametrize(
    ("first", "second", "p"), [(0, 0, 1.0), (5, 5, 1.0), (0, 5, 0.0625), (0, 6, 0.03125), (1, 9, 0.021484375)]
)
def test_mcnemar_is_the_exact_binomial_test(first: int, second: int, p: float) -> None:
    assert mcnemar(first, second) == mcnemar(second, first) == p


def test_mcnemar_takes_thousands_of_differing_runs() -> None:
    assert mcnemar(1000, 1400) < 1e-9


def test_failures_are_alike_by_the_rule_that_is_broken_or_by_their_text_without_numbers() -> None:
    lost, armed = (Violation(rule, 3.0, "uav1") for rule in ("mail lost", "on the ground"))
    one, two = Outcome(1, False, "link lost for 5.1 s"), Outcome(1, False, "link lost for 6 s")
    assert same_cause(one, two)
    assert not same_cause(one, Outcome(1, False, "battery empty"))
    assert not same_cause(one, Outcome(1, True))
    assert not same_cause(one, Outcome(1, False, "stopped after 3 s, as wanted", stopped=True))
    assert not same_cause(one, Outcome(1, False, "link lost for 7 s", violations=[lost]))
    assert same_cause(Outcome(1, True, violations=[lost]), Outcome(1, False, "other", violations=[armed, lost]))
    assert not same_cause(Outcome(1, True, violations=[lost]), Outcome(1, False, violations=[armed]))


def test_numbers_and_ids_do_not_separate_causes() -> None:
    texts = ["no heartbeat for 5.1 s", "no heartbeat for 12 s", "the bridge restarted", "of 3f2ab9d01c of -2"]
    outcomes = [Outcome(seed, False, text) for seed, text in enumerate([*texts, "of 00aa0b9d77 of 4"])]
    found = [(cause.text, cause.seeds) for cause in causes(outcomes)]
    assert found == [(texts[0], [0, 1]), (texts[3], [3, 4]), (texts[2], [2])]


def test_words_separate_causes_and_a_violation_comes_before_the_end_of_the_mission() -> None:
    violation = Violation("limits", 3.0, "uav1 is at 70.0 m of 60 m")
    outcomes = [Outcome(1, False, "timeout"), Outcome(2, False, "timeout", violations=[violation]), Outcome(3, True)]
    assert {cause.text: cause.seeds for cause in causes(outcomes)} == {
        "timeout": [1],
        "limits: uav1 is at 70.0 m of 60 m": [2],
    }


def test_quantiles_are_values_of_runs() -> None:
    assert quantiles([float(n) for n in range(1, 101)]) == (1.0, 50.0, 95.0, 100.0)
    assert quantiles([7.0]) == (7.0, 7.0, 7.0, 7.0)
    with pytest.raises(ValueError, match="no values"):
        quantiles([])


def test_distributions_are_those_of_the_runs_that_succeed() -> None:
    outcomes = [Outcome(1, True, seconds=80.0, battery=0.5), Outcome(2, False, seconds=9.0, battery=0.1)]
    found = {one.name: one.values for one in distributions(outcomes)}
    assert found["duration"] == [80.0]
    assert found["battery left"] == [50.0]
    assert "nearest approach" not in found, "one vehicle is near no other"


def test_each_value_is_in_one_bin() -> None:
    bins = histogram([1.0, 1.0, 2.0, 5.0])
    assert sum(number for _, _, number in bins) == 4
    assert (bins[0][0], bins[-1][1]) == (1.0, pytest.approx(5.0))
    assert bins[0][2] == 2
    assert bins[-1][2] == 1
    assert histogram([3.0, 3.0]) == [(3.0, 3.0, 2)]


def test_faults_are_counted_by_kind_and_a_seed_is_none() -> None:
    kill, loss = Kill(daemon="commd"), Vehicle(robot="uav1", fault="loss=0.2")
    outcomes = [
        Outcome(1, False, faults=[kill, kill, loss]),
        Outcome(2, True, faults=[kill, Vehicle(robot="uav1", fault="seed=3")]),
        Outcome(3, True, faults=[BoardDown(board="pi1", seconds=1.0)]),
    ]
    assert fault_shares(outcomes) == [
        FaultShare("board_down", 1, 1, 0),
        FaultShare("kill", 3, 2, 1),
        FaultShare("vehicle loss", 1, 1, 1),
    ]
