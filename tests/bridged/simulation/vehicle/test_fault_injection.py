"""Each row of the fault table (docs/measurements/faults.md): every action ends once, and is what the robot's own
state says."""

from collections.abc import Callable
from pathlib import Path

import pytest

from schemas.wire.records import ActionStatus
from tests.faults.real import REAL
from tests.faults.rows import Ended, Row
from tests.faults.virtual import VIRTUAL


@pytest.mark.parametrize("fault", [*VIRTUAL, *REAL], ids=lambda fault: fault.__name__)
def test_every_action_ends_once_with_its_true_status_under(fault: Callable[[Path], Row], tmp_path: Path) -> None:
    row = fault(tmp_path)
    assert row.ended
    assert row.wrong() == []


def test_the_table_notices_a_success_that_was_not() -> None:
    done = ActionStatus(id="a", state="succeeded", result=True)
    lost = ActionStatus(id="a", state="failed", result=False)
    assert Ended("takeoff(5)", (done,), held=False, seconds=1).problems
    assert Ended("takeoff(5)", (done, done), held=True, seconds=1).problems
    assert Ended("takeoff(5)", (), held=True, seconds=1).problems
    assert Ended("takeoff(5)", (lost,), held=False, seconds=1).problems == ["takeoff(5): failed without a reason"]
    assert Ended("takeoff(5)", (done,), held=True, seconds=1).problems == []
