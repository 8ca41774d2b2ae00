"""What pages show of robots works as they say: a room and a camera on Zenoh keys, programs for a copter."""

import asyncio
import re
import subprocess
import sys
from pathlib import Path

import pytest

from agentd.__main__ import main
from schemas.mission.model import read_mission
from tests.bridged.sky import end_of
from tests.bridged.studio import MISSIONS, in_the_studio
from tests.support.buses import until

ROOT = Path(__file__).parents[2]
CAMERA = ROOT / "examples" / "camera" / "camera.py"
MISSION = """
mission: search
agents: {scout: {program: a.asl, robot: uav1}}
robots: {uav1: {manifest: camera.toml, prefix: uav1}}
"""


def shown(page: str, *kinds: str) -> list[str]:
    """The blocks of these kinds of a page or a part of it."""
    return [text for _, text in re.findall(rf"^```({'|'.join(kinds)})\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)]


async def test_the_room_of_the_page_is_a_robot(endpoint: str, tmp_path: Path) -> None:
    page = (ROOT / "docs/guides/drivers.md").read_text()
    robot, manifest, mission = shown(page.partition("\n## zenoh\n")[2], "python", "toml", "yaml")[:3]
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


async def test_a_scout_perceives_whom_a_camera_program_tells_of(endpoint: str, tmp_path: Path) -> None:
    shipped = (MISSIONS / "search_and_rescue" / "scout.toml").read_text(encoding="utf-8")
    percept = shipped[shipped.index("[percepts.victim]") : shipped.index("[actions.")]
    (tmp_path / "camera.toml").write_text(f'[robot]\ndriver = "zenoh"\n{percept}')
    mission = read_mission(MISSION, tmp_path / "search.yaml")
    async with in_the_studio(endpoint, tmp_path, mission=mission, simulated=False) as studio:
        program = CAMERA.read_text(encoding="utf-8")
        assert "\nREMEMBERED = 10.0\n" in program
        (tmp_path / "camera.py").write_text(program.replace("REMEMBERED = 10.0", "REMEMBERED = 2.0"))
        command = [sys.executable, str(tmp_path / "camera.py"), "uav1/victim", endpoint]
        camera = await asyncio.create_subprocess_exec(*command, stdin=asyncio.subprocess.PIPE)
        try:
            camera.stdin.write(b"7 -27.6035 -48.5182\n")
            await until(lambda: studio.values("victim") == (7, -27.6035, -48.5182), "the victim is perceived")
            camera.stdin.close()
            async with asyncio.timeout(120):
                assert await camera.wait() == 0
        finally:
            if camera.returncode is None:
                camera.kill()
                await camera.wait()


@pytest.mark.parametrize("number", [0, 1])
def test_the_programs_of_the_page_are_right(number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = tmp_path / "page.asl"
    program.write_text(shown((ROOT / "docs/reference/actions.md").read_text(encoding="utf-8"), "asl")[number])
    code = main(["check", "--manifest", "copter", str(program)])
    said = [line for line in capsys.readouterr().err.splitlines() if "is never" not in line and "no plan" not in line]
    assert (code, said) == (0, [])
