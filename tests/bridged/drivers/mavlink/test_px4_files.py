"""Plans, parameters and logs of a simulated PX4, whose items, integers and logs are numbered and sent its own way."""

from pathlib import Path

import pytest

from bridged.drivers.mavlink.actions.mission_items import Item
from bridged.simulation.vehicle.kinds import KINDS
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.wire.vehicle_records import PlanItem
from tests.bridged.drivers.mavlink.actions.test_log_download import logs
from tests.bridged.drivers.mavlink.actions.test_operator_requests import ended, setting
from tests.bridged.drivers.mavlink.test_plan_files import HOME as RTL
from tests.bridged.drivers.mavlink.test_plan_files import TAKEOFF, THERE, plan, simple, survey
from tests.bridged.sky import HOME, Sky


@pytest.fixture
def px4(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sky:
    """A copter with PX4 that is heard and has a home."""
    monkeypatch.chdir(tmp_path)
    sky = Sky(tmp_path, vehicle=Vehicle(HOME, KINDS["copter", "px4"]))
    sky.forward(lambda: sky.belief("home_pos"), "home")
    return sky


def test_a_plan_is_stored_without_home_and_read_back_as_it_was(px4: Sky, tmp_path: Path) -> None:
    jump = simple(177, 2, 1, 0, 0, 0, 0, 0, frame=2, jump=9)
    (tmp_path / "field.plan").write_text(plan(TAKEOFF, survey(THERE, THERE), jump, RTL))
    px4.done("upload_plan", "field.plan")
    items: list[PlanItem] = []
    assert ended(px4, px4.driver.read_plan(items)).state == "succeeded"
    assert [item.command for item in items] == [16, 22, 16, 16, 177, 20]
    assert items[4].parameters[0] == 2, "the first of the survey, counted from 1"
    assert (items[0].x, items[2].z) == (Item(x=-276040330).x, 20.0)
    assert px4.driver.identified_as == (12, 2)


def test_parameters_are_read_as_numbers_and_set_by_their_type(px4: Sky) -> None:
    values: dict[str, float] = {}
    assert ended(px4, px4.driver.read_parameters(values)).state == "succeeded"
    assert (values["SYS_AUTOSTART"], values["BAT1_A_PER_V"]) == (10040, pytest.approx(36.4))
    assert setting(px4, "SYS_AUTOSTART", 2.0**24 + 1)[0] == "succeeded"
    assert px4.vehicle.autopilot.parameters["SYS_AUTOSTART"] == 2**24 + 1
    assert setting(px4, "NAV_RCL_ACT", 0) == ("refused", "request")
    assert setting(px4, "NO_SUCH", 0)[0] == "failed"


def test_its_log_is_a_ulog_that_is_numbered_from_0(px4: Sky, tmp_path: Path) -> None:
    px4.done("download_log")
    (path,) = logs(tmp_path)
    assert (path.name[:13], path.suffix) == ("uav1-log00000", ".ulg")
    content = path.read_bytes()
    assert content.startswith(b"ULog\x01\x12\x35\x01")
    assert b"int32_t SYS_AUTOSTART" in content
