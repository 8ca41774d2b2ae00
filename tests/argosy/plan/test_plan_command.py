"""`argosy plan show`: a plan file as `upload_plan` would take it."""

from pathlib import Path

import pytest

from argosy.__main__ import main
from tests.bridged.drivers.mavlink.test_plan_files import HOME, RALLY, TAKEOFF, THERE, plan


def test_the_items_of_a_plan_are_listed_the_rest_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "field.plan"
    path.write_text(plan(TAKEOFF, THERE, HOME, geoFence={"breachReturn": [-27.6, -48.5, 20]}, rallyPoints=RALLY))
    assert main(["plan", "show", str(path)]) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines() == [
        f"{path}: 3 items, 50 m from the first place to the last",
        "item  command      latitude    longitude  altitude         parameters",
        "   1  takeoff   -27.6040330  -48.5183630  10 m above home",
        "   2  waypoint  -27.6036830  -48.5180520  20 m above home",
        "   3  rtl",
        "rally points: 1 item",
    ]
    assert printed.err == f"note: {path}: not taken from the file: the breach return point\n"


def test_a_file_that_cannot_be_taken_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "field.plan"
    path.write_text(plan(THERE | {"frame": 7}))
    assert main(["plan", "show", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {path}: item 1: frame 7 is neither above home")
