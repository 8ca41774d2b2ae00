"""A robot of several drivers: a copter on MAVLink whose gripper is the work of Python functions."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from unittest.mock import Mock

import pytest

from bridged.bridge.safety_orders import by_operator
from bridged.drivers.python.driver import PythonDriver
from bridged.drivers.registry import check_manifest
from schemas.manifest.loader import find_manifest, read_manifest
from schemas.wire.records import ManifestChange
from tests.bridged.plugins import install
from tests.bridged.sky import GOAL, Sky

GRIPPER = """
import time
__all__ = ["holds", "reel"]
log = []

def holds(): return "closed" not in log

def reel(metres):
    try:
        while True:
            yield {"to_go": metres}
            time.sleep(0.01)
    finally:
        log.append("closed")
"""
ENTRIES = """
[percepts.holds]
driver = "python"
source = "gripper.holds"
args = ["data"]
rate = 50

[actions.reel]
driver = "python"
params = [{name = "metres"}]
call = "gripper.reel"
motion = false
"""


class Rigged:
    """The sky, with the gripper at the copter; time passes for both while the event loop runs."""

    def __init__(self, state: Path) -> None:
        file = find_manifest("copter")
        manifest = read_manifest(file.read_text() + ENTRIES, "rigged.toml")
        assert check_manifest(manifest) == []
        self.sky = Sky(state, manifest=manifest)
        gripper = self.sky.bridge.driver._drivers["python"]  # type: ignore[attr-defined]
        assert isinstance(gripper, PythonDriver)
        self.gripper = gripper

    async def until(self, condition: Callable[[], object], wish: str, within: float = 120) -> None:
        """Let time pass until a wish is true, both mission seconds for the copter and a little for the threads."""
        end = self.sky.clock.time + within
        while not condition():
            assert self.sky.clock.time < end, f"{wish} did not happen within {within:g} s"
            for _ in range(5):
                self.sky.step()
            await asyncio.sleep(0.01)


@pytest.fixture
@asynccontextmanager
async def rig(site: Path) -> AsyncIterator[Rigged]:
    """Run the gripper's driver; the copter's is moved by the sky."""
    rig = Rigged(site)
    running = asyncio.create_task(rig.gripper.run())
    try:
        yield rig
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        rig.sky.bridge.action_log.close()


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Install the gripper's functions."""
    install(monkeypatch, tmp_path, {"my_gripper": GRIPPER}, {"argosy.python": {"gripper": "my_gripper"}})
    return tmp_path


def test_a_driver_that_fails_to_take_the_old_manifest_back_keeps_no_other_from_it_and_is_reported(
    site: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rigged(site)
    bridge, old = rig.sky.bridge, rig.gripper.manifest
    monkeypatch.setattr(rig.sky.driver, "adopt", Mock(side_effect=[KeyError("rate"), KeyError("rate"), None]))
    change = ManifestChange(set={"percepts.holds.rate": 3})
    problems = bridge.live.change(change)
    assert len(problems) == 2
    assert rig.gripper.manifest == old
    assert [note.text for note in bridge.notes() if note.code == "manifest_mixed"] == problems[1:]
    assert bridge.live.change(change) == []
    assert "manifest_mixed" not in [note.code for note in bridge.notes()]


async def test_percepts_and_figures_of_all_drivers_of_a_robot_are_told(rig: Rigged) -> None:
    sky = rig.sky
    await rig.until(lambda: sky.belief("holds") == (True,), "the gripper's percept")
    await rig.until(lambda: sky.belief("altitude") is not None, "the copter's percept")
    counters = sky.bridge.health().counters
    assert counters["messages"] > 0
    assert counters["calls"] > 0


async def test_an_order_ends_the_actions_of_all_drivers_and_moves_the_robot_by_its_own(rig: Rigged) -> None:
    sky = rig.sky
    sky.flying(10)
    going, reeling = sky.begin("goto", *GOAL), sky.begin("reel", 5)
    await rig.until(lambda: going[-1].state == "running" and any(one.feedback for one in reeling), "both run")
    assert any(one.feedback.get("to_go") == 5 for one in reeling)
    sky.bridge.action_server.order("rtl", by_operator("rtl"), block=True, insist=True)
    assert {(one[-1].state, one[-1].cause, one[-1].order) for one in (going, reeling)} == {
        ("failed", "operator", "rtl")
    }
    await rig.until(lambda: sky.belief("holds") == (False,), "the generator is closed")
    await rig.until(lambda: (sky.belief("state") or ("",))[0] == "RTL", "the copter returns")


async def test_what_one_driver_refuses_the_other_still_does(rig: Rigged) -> None:
    sky = rig.sky
    first = sky.begin("reel", 5)
    await rig.until(lambda: bool(first) and first[-1].state == "running", "it runs")
    second = sky.begin("reel", 6)
    assert second[-1].state == "refused"
    assert "`gripper.reel` has not returned from its last call" in second[-1].reason
    status = sky.begin("set_mode", "GUIDED")
    await rig.until(lambda: status[-1].final, "the copter's action")
    assert status[-1].state == "succeeded"


async def test_figures_of_one_name_of_two_drivers_are_added(rig: Rigged) -> None:
    rig.sky.driver.counters = lambda: {"calls": 1000}  # type: ignore[method-assign]
    await rig.until(lambda: rig.gripper.counters()["calls"], "the gripper is called")
    assert rig.sky.bridge.driver.counters()["calls"] == 1000 + rig.gripper.counters()["calls"]


async def test_an_order_is_carried_out_although_another_driver_cannot_end_its_action(rig: Rigged) -> None:
    sky = rig.sky
    sky.flying(10)
    reeling = sky.begin("reel", 5)
    await rig.until(lambda: reeling[-1].state == "running", "it runs")
    rig.gripper.stop = Mock(side_effect=KeyError("reel"))  # type: ignore[method-assign]
    sky.bridge.action_server.order("rtl", by_operator("rtl"), block=True, insist=True)
    assert (reeling[-1].state, reeling[-1].cause) == ("failed", "operator")
    await rig.until(lambda: (sky.belief("state") or ("",))[0] == "RTL", "the copter returns")
