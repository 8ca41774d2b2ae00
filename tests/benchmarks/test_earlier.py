"""An earlier revision beside this one: how costs are judged."""

from __future__ import annotations

import pytest

from benchmarks.earlier import PAIRS, Costs, Figures, compared_costs, goals, trees
from benchmarks.parts import PARTS
from benchmarks.processes import BenchmarkFailed


def test_a_revision_that_the_clone_does_not_have_is_reported() -> None:
    with pytest.raises(BenchmarkFailed, match="revision 0000000 is not in this clone"), trees("0000000"):
        pass


def test_every_probe_is_run() -> None:
    assert PAIRS.keys() == {part.name for part in PARTS if hasattr(part.module(), "probe")}


@pytest.mark.parametrize(
    ("now", "met", "decided", "verdict"),
    [
        ([104.0, 90.0, 104.9], True, True, ""),
        ([106.0, 107.0, 120.0], False, True, "**worse**"),
        ([100.0, 106.0, 120.0], False, False, "not decided"),
    ],
)
def test_a_cost_may_be_five_per_cent_more_than_then(now: list[float], met: bool, decided: bool, verdict: str) -> None:
    figures = Figures(probes={"mail": {"a (ms)": Costs([100.0] * 3, now), "b (MB)": Costs([10.0] * 3, [9.0] * 3)}})
    (goal,) = goals(figures)
    assert (goal.met, goal.decided) == (met, decided)
    assert goal.found.endswith("(a (ms))")
    _, _, a, b = compared_costs(figures)
    assert a.endswith(f"| {verdict} |")
    assert b == "| mail: b (MB) | 10 | 9 | 0.900 (0.900 to 0.900) | |".replace("| |", "|  |")
