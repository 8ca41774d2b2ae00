"""Defects that trials have found: each run shows that one does not come back."""

from __future__ import annotations

from pathlib import Path

import pytest

from argosy.trial.faults import BoardDown, Fault, Kill
from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import workers

MISSIONS = Path(__file__).parents[3] / "missions"


def fly(mission: str, seed: int, *faults: Fault, until: float | None = None) -> Outcome:
    """Fly a shipped mission once."""
    with workers(1) as run_all:
        request = Request(str(MISSIONS / f"{mission}.yaml"), seed, faults, journal=True, until=until)
        return next(run_all([request]))


@pytest.mark.parametrize(
    "fault",
    [Kill(at=34.2, daemon="agentd:local"), BoardDown(at=34.2, board="local", seconds=2.0)],
    ids=["agentd", "board"],
)
def test_daemons_that_are_killed_go_on_with_their_files(fault: Fault) -> None:
    outcome = fly("single_uav", 10, fault, until=60)
    assert any("killed by SIGKILL" in line for line in outcome.journal)
    assert not [line for line in outcome.journal if "corrupt" in line]


def test_a_vehicle_that_landed_while_its_board_was_down_is_home_for_a_bridge_that_has_just_heard_it() -> None:
    outcome = fly("single_uav", 14, BoardDown(at=75.5, board="local", seconds=11.5))
    assert outcome.success, outcome.why


def test_a_target_waits_for_the_home_of_a_vehicle_that_a_bridge_has_just_heard() -> None:
    outcome = fly("single_uav", 25, BoardDown(at=21.8, board="local", seconds=12.3))
    assert outcome.success, outcome.why
