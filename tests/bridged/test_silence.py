"""What the bridge says of a vehicle that cannot be heard: in its log, in health, when it leaves, in wall seconds."""

import asyncio
import logging
import re
from pathlib import Path

import pytest

from schemas.wire.log_lines import RobotLeft
from tests.bridged.sky import GOAL, Sky
from tests.support.notes import identities


def left(sky: Sky) -> RobotLeft:
    """How the bridge leaves its vehicle."""
    return asyncio.run(sky.bridge.orders.shut_down("rtl"))


def silent(sky: Sky, seconds: float) -> Sky:
    """Let mission time pass in which nothing of the vehicle arrives."""
    sky.we_hear = lambda message: False
    sky.wait(seconds)
    return sky


def test_a_vehicle_that_is_heard_and_not_armed_is_left_as_that(sky: Sky) -> None:
    sky.wait(3)
    assert (left(sky).state, left(sky).text) == ("disarmed", "not armed")
    found = left(silent(sky, 10))
    assert found.state == "unconfirmed"
    assert re.fullmatch(r"not armed when last heard \d+ s ago", found.text)


def test_a_vehicle_lost_while_armed_is_left_as_last_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridged.bridge.safety_orders.ORDER_PATIENCE", 0.01)
    found = left(silent(Sky(tmp_path).flying(), 20))
    assert (found.state, found.order) == ("unconfirmed", None)
    assert re.match(r"armed when last heard (19|20|21) s ago, and it has not confirmed rtl: ", found.text), found


def test_a_normal_start_warns_of_no_missing_heartbeat_and_an_absent_vehicle_is_a_warning(tmp_path: Path) -> None:
    sky = silent(Sky(tmp_path, speed=5), 2.5 * 5)
    assert sky.driver.notes() == []
    sky.wait(1.0 * 5)
    assert identities(sky.driver.notes()) == [("no_heartbeat", "1")]


def test_a_silent_link_is_not_blamed_on_the_rates_of_its_messages(tmp_path: Path) -> None:
    sky, notes = Sky(tmp_path).flying(), set[tuple[str, str]]()
    sky.we_hear = lambda message: False
    for _ in range(100):
        sky.wait(0.1)
        notes.update(identities(sky.driver.notes()))
    assert notes == {("no_heartbeat", "1")}
    sky.we_hear = lambda message: True
    sky.forward(lambda: sky.driver.heard, "the vehicle is heard again", 5)
    assert sky.driver.notes() == []


def test_silence_is_told_in_the_wall_seconds_of_the_manifest(tmp_path: Path) -> None:
    sky = Sky(tmp_path, speed=5).flying()
    going = sky.begin("goto", *GOAL)
    sky.wait(1)
    sky.we_hear = lambda message: False
    sky.end(going)
    assert going[-1].reason == "link lost: no heartbeat for 5.0 s"


def test_the_log_says_when_a_vehicle_is_heard_lost_and_back(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "mavlink")
    sky = silent(Sky(tmp_path).flying(), 10)
    sky.we_hear = lambda message: True
    sky.wait(3)
    said = [record.message for record in caplog.records if record.name == "mavlink"]
    assert said[:2] == [
        "system 1 is heard now: STABILIZE, not armed",
        "system 1 is lost: no heartbeat for 5.0 s; it was in GUIDED, armed",
    ]
    assert re.fullmatch(r"system 1 is heard again after 1[01]\.\d s: GUIDED, armed", said[2])
    assert len(said) == 3
