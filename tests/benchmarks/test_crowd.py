"""Part "crowd": when a crowd is outgrown, and which goals it misses."""

from __future__ import annotations

from benchmarks.measurements import crowd as crowds
from benchmarks.measurements.crowd import Crowd, Loaded
from benchmarks.results import Origin
from benchmarks.spread import Spread

ORIGIN = Origin("2026-01-01", "a machine", 2, 8.0, "Linux", "3.11", {}, "abc", 0.0, 0.0, "make bench")


def _crowd(agents: int, rate: float, eased: float, *, p99: float = 20.0, answered: int | None = None) -> Crowd:
    took = Spread(2 * agents, 12.0, 10.0, p99, 30.0)
    loads = [Loaded(2 * agents, 2 * agents, one, took, 12, 18, 50, 40) for one in (rate, eased)]
    made = Crowd(agents, 1, 0.01 * agents, 40 + 0.1 * agents, 40, 1 + 0.002 * agents, 1, 1, *loads)
    if answered is not None:
        assert made.hurried is not None
        made.hurried.answered, made.eased = answered, None
    return made


def _crowds(*largest: Crowd) -> crowds.Figures:
    alone = Crowd(1, 1, 0.01, 40.2, 40, 1.01, 1, 1)
    return crowds.Figures([alone, _crowd(10, 5000, 1), _crowd(100, 5000, 9), *largest], 0.1, 20.0)


def test_a_crowd_that_does_not_keep_up_is_outgrown_and_its_goal_missed() -> None:
    figures = _crowds(_crowd(1000, 4900, 90))
    assert "every one keeps up" in crowds.blocks(ORIGIN, figures)["crowd"]
    assert all(goal.met for goal in crowds.goals(figures)), crowds.goals(figures)
    for slow, why in (
        (_crowd(1000, 4900, 79), "There 79 messages/s, 100 are asked"),
        (_crowd(1000, 4900, 90, p99=2100), "There p99 of an answer is 2.1 s"),
    ):
        text = crowds.blocks(ORIGIN, _crowds(slow))["crowd"]
        assert "1,000 agents are the smallest that do not keep up" in text
        assert why in text
    _, missed = [goal for goal in crowds.goals(_crowds(_crowd(1000, 2950, 90))) if not goal.met]
    assert missed.found == "59%"
    assert "Tried: " in missed.why


def test_questions_that_were_not_answered_are_told_and_miss_the_goal() -> None:
    figures = _crowds(_crowd(1000, 200, 90, answered=987))
    first = crowds.goals(figures)[0]
    assert (first.met, first.wanted, first.found) == (False, "all 2,000", "987")
    assert "Tried: " in first.why
    text = crowds.blocks(ORIGIN, figures)["crowd"]
    assert "| 1,000 | 2,000 | 987 |" in text
    assert "questions asked at once were still not answered" in text
