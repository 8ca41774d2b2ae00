"""What docs/guides/drivers.md shows works as it says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from schemas.mission.model import read_mission
from tests.bridged.sky import end_of
from tests.bridged.studio import in_the_studio
from tests.support.buses import async_test, until

PAGE = Path(__file__).parents[2] / "docs/guides/drivers.md"


@async_test
async def test_the_room_of_the_page_is_a_robot(endpoint: str, tmp_path: Path) -> None:
    section = PAGE.read_text().partition("\n## zenoh\n")[2]
    robot, manifest, mission = (
        text for _, text in re.findall(r"^```(python|toml|yaml)\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)[:3]
    )
    (tmp_path / "room.py").write_text(robot)
    (tmp_path / "room.toml").write_text(manifest)
    async with in_the_studio(
        endpoint, tmp_path, mission=read_mission(mission, tmp_path / "heating.yaml"), simulated=False
    ) as studio:
        arguments = [sys.executable, str(tmp_path / "room.py"), endpoint]
        with subprocess.Popen(arguments, stdout=subprocess.DEVNULL) as process:  # noqa: ASYNC220
            try:
                await until(lambda: studio.values("climate") == (17.0, False), "the climate is perceived")
                assert (await studio.do("air")).state == "succeeded"
                await until(lambda: studio.values("climate") == (15.0, False), "it is cooler")
                assert (await studio.do("heat", True)).state == "succeeded"
                await until(lambda: studio.values("climate")[1] is True, "the heater is on")
                assert end_of(await studio.do("air")) == ("failed", "room1/air: the heater is on")
            finally:
                process.kill()
        await until(lambda: not studio.values("climate"), "the climate is gone")
        assert (await studio.do("heat", True)).reason == "nobody subscribes to room1/heater"
