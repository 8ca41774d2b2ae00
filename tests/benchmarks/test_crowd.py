"""Parts "crowd" and "routers": small ones are measured for real, and pages say what the figures say."""

from __future__ import annotations

import asyncio
from pathlib import Path

from benchmarks.crowd import part as crowds
from benchmarks.crowd.run import Crowd, Loaded, crowd
from benchmarks.results import Origin
from benchmarks.routers import part as routers
from benchmarks.routers.load import Load, payload
from benchmarks.routers.part import Stretch

ORIGIN = Origin("2026-01-01", "a machine", 2, 8.0, "Linux", "3.11", {}, "abc", 0.0, 0.0, "make bench")


def test_a_small_crowd_answers_all_its_questions(tmp_path: Path) -> None:
    found = asyncio.run(crowd(tmp_path, 4, 0.5, 3, 0.5))
    assert found.hurried is not None
    assert found.eased is not None
    assert found.rss > 0
    assert 0 < found.hurried.p50 <= found.hurried.p99 <= found.hurried.worst
    assert found.hurried.fairness >= 1


def _crowd(agents: int, rate: float, eased: float) -> Crowd:
    loads = [Loaded(one, 10, 20, 30, 12, 18, 50, 40) for one in (rate, eased)]
    return Crowd(agents, 1, 0.01 * agents, 40 + 0.2 * agents, 40, 1 + 0.01 * agents, 1, 1, *loads)


def test_a_crowd_that_does_not_keep_up_is_outgrown_and_its_goal_missed() -> None:
    alone = Crowd(1, 1, 0.01, 40.2, 40, 1.01, 1, 1)
    figures = crowds.Figures([alone, _crowd(10, 300, 1), _crowd(1000, 290, 90)], 0.1, 20.0)
    text = crowds.blocks(ORIGIN, figures)["crowd"]
    assert "every one keeps up" in text
    assert all(goal.met for goal in crowds.goals(figures)), crowds.goals(figures)
    figures.crowds[-1] = _crowd(1000, 100, 40)
    assert "1,000 agents do not keep up" in crowds.blocks(ORIGIN, figures)["crowd"]
    (missed,) = [goal for goal in crowds.goals(figures) if not goal.met]
    assert missed.found == "33%"
    assert crowds.pictures(figures).keys() == {"crowd-cost", "crowd-mail"}


def _routers(silent: float) -> routers.Figures:
    sizes = {"a percept, nobody listens there": silent, "a percept, somebody listens there": 200.0}
    links = {"n2-n1": 30.0, "n1-s1": 2000.0, "s1-s2": 10.0}
    starting = {"n2-n1": 5000, "n1-s1": 6000, "s1-s2": 7000}
    loads = [Load(1000, 1000, 1000, 2, 1, 1), Load(0, 500_000, 100_000, 100, 100, 100)]
    return routers.Figures(2, 1.0, sizes, [Stretch("flying", 10, links)], starting, len(payload()), loads)


def test_percepts_that_cross_without_a_listener_miss_the_goal() -> None:
    assert [goal.met for goal in routers.goals(_routers(1.0))] == [True]
    assert [goal.met for goal in routers.goals(_routers(150.0))] == [False]


def test_the_page_of_the_routers_tells_what_crosses_and_when_one_is_full() -> None:
    text = routers.blocks(ORIGIN, _routers(1.0))["routers"]
    assert "| flying | 30 | 2,000 | 10 |" in text
    assert "50,000 percepts a second" in text  # 1,000 a second take 2 % of a core
    assert routers.pictures(_routers(1.0)).keys() == {"routers-links"}
