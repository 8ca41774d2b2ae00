"""Shipped missions by the other autopilot: the same programs and manifests, only what is simulated differs."""

import re
from pathlib import Path

import pytest

from tests.argosy.trial.conftest import MISSIONS, Fly
from tests.docs.six_kinds_page import LANDING

PX4 = {
    "single_uav": {"vehicle: copter": "vehicle: copter, autopilot: px4"},
    "paper_uav": {"vehicle: copter": "vehicle: copter, autopilot: px4"},
    "three_uavs": {"vehicle: copter": "vehicle: copter, autopilot: px4"},
    "search_and_rescue": {
        "parameters: {LAND_SPEED: 100}": """\
autopilot: px4
      parameters: {MPC_LAND_SPEED: 1, PWM_MAIN_FUNC9: 301, COM_PREARM_MODE: 2}""",
        "-27.602955": "-27.603404",  # half of its area, and two of its victims
        "victims: 8": "victims: 2",
    },
    "relay": {
        "vehicle: copter, autopilot: px4": "vehicle: copter",
        "vehicle: rover": "vehicle: rover, autopilot: px4",
        "vehicle: plane": "vehicle: plane, autopilot: px4",
        '"next(copter)"': f'"next(copter)", {LANDING!r}',
    },
}
"""What is replaced in a mission; the relay's copter is a PX4, its plane and rover are not."""
NOT_OF_THE_AIR = {"turtle", "paper_turtle"}


def test_each_shipped_mission_of_vehicles_is_flown_by_both_autopilots() -> None:
    assert {path.stem for path in MISSIONS.glob("*.yaml")} == set(PX4) | NOT_OF_THE_AIR


@pytest.mark.parametrize("mission", PX4)
def test_a_shipped_mission_is_done_by_the_other_autopilot(fly: Fly, tmp_path: Path, mission: str) -> None:
    text = (MISSIONS / f"{mission}.yaml").read_text()
    for old, new in PX4[mission].items():
        assert old in text
        text = re.sub(re.escape(old), new, text)
    (tmp_path / f"{mission}.yaml").write_text(text)
    (tmp_path / mission).symlink_to(MISSIONS / mission)
    outcome = fly(str(tmp_path / mission), 1)
    assert outcome.success, outcome.why
    assert outcome.violations == []
    assert [line for line in outcome.journal if "left it: armed" in line] == []
