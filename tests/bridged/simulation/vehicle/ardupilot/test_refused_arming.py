"""Why a vehicle cannot be armed is said at once, in log, status and percept, and what stays so is not waited for."""

import logging
from pathlib import Path

import pytest

from bridged.simulation.vehicle.fault_injection import Faults
from schemas.wire.terms import Atom
from tests.bridged.sky import Sky


def flown(tmp_path: Path, *faults: str) -> Sky:
    sky = Sky(tmp_path, faults=Faults.parse(faults))
    sky.wait(10)
    sky.done("set_mode", "GUIDED")
    return sky


def waits(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [said.partition(" waits: ")[2] for record in caplog.records if " waits: " in (said := record.getMessage())]


def cause(sky: Sky) -> object:
    told = sky.beliefs("feedback")
    return next((text for _, what, text in told if what == Atom("cause")), None)


def test_what_mends_itself_is_told_within_3_s_and_waited_for(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    sky = flown(tmp_path, "prearm=30:GPS 1: Bad fix")
    with caplog.at_level(logging.WARNING):
        heard = sky.begin("arm_motors", True)
        sky.wait(3)
        assert "GPS 1: Bad fix" in heard[-1].reason
        assert heard[-1].state == "running"
        assert cause(sky) == "GPS 1: Bad fix"
        assert waits(caplog) == ["GPS 1: Bad fix"]
        assert sky.end(heard, 60).state == "succeeded"
    assert cause(sky) is None
    assert waits(caplog)[:1] == ["GPS 1: Bad fix"]
    assert all("GPS" not in one for one in waits(caplog)[1:]), "it is told once while it does not change"


def test_a_cause_that_changes_is_told_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    sky = flown(tmp_path, "prearm=25:GPS 1: Bad fix", "prearm=40:Gyros inconsistent")
    with caplog.at_level(logging.WARNING):
        heard = sky.begin("arm_motors", True)
        assert sky.end(heard, 60).state == "succeeded"
    named = [one for one in waits(caplog) if "SYS_STATUS" not in one]
    assert [named[0], named[-1]] == ["GPS 1: Bad fix", "Gyros inconsistent"]


@pytest.mark.parametrize("text", ["Compass not calibrated", "Battery 1 below minimum arming voltage"])
def test_what_does_not_mend_itself_fails_at_once_with_the_vehicles_words(tmp_path: Path, text: str) -> None:
    sky = flown(tmp_path, f"prearm={text}")
    heard = sky.begin("arm_motors", True)
    assert sky.end(heard, 3).state == "refused"
    assert heard[-1].reason == f"the vehicle refuses to arm until a person corrects this: {text}"


def test_a_hardware_fault_fails_when_two_checks_have_named_it(tmp_path: Path) -> None:
    sky = flown(tmp_path, "prearm=Compass not healthy")
    heard = sky.begin("arm_motors", True)
    took = sky.forward(lambda: heard[-1].final, "the end", 8)
    assert heard[-1].state == "refused"
    assert took > 4, "a single check may name what is over in a moment"


def test_a_short_fault_of_a_sensor_is_waited_for(tmp_path: Path) -> None:
    sky = flown(tmp_path, "prearm=15:Compass not healthy")
    sky.done("arm_motors", True)


def test_texts_that_answer_an_arming_are_logged_as_its_cause(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        Sky(tmp_path).flying(5)
    assert [record.getMessage() for record in caplog.records if "PreArm" in record.getMessage()] == []


def test_what_was_named_before_an_arming_began_is_not_held_against_it(tmp_path: Path) -> None:
    sky = Sky(tmp_path, faults=Faults.parse(["prearm=13:Compass not calibrated", "prearm=25:GPS 1: Bad fix"]))
    sky.wait(12)
    assert sky.do("arm_motors", True).state == "refused"
    sky.wait(1.2)
    sky.done("arm_motors", True)
