"""examples/camera: what a camera program publishes is a percept of the scout's manifest, as it ships."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from schemas.mission.model import read_mission
from tests.bridged.studio import MISSIONS, in_the_studio
from tests.support.buses import async_test, until

CAMERA = Path(__file__).parents[2] / "examples" / "camera" / "camera.py"
MISSION = """
mission: search
agents: {scout: {program: a.asl, robot: uav1}}
robots: {uav1: {manifest: camera.toml, prefix: uav1}}
"""


@async_test
async def test_a_scout_perceives_whom_a_camera_program_tells_of(endpoint: str, tmp_path: Path) -> None:
    shipped = (MISSIONS / "search_and_rescue" / "scout.toml").read_text(encoding="utf-8")
    percept = shipped[shipped.index("[percepts.victim]") : shipped.index("[actions.")]
    (tmp_path / "camera.toml").write_text(f'[robot]\ndriver = "zenoh"\n{percept}')
    mission = read_mission(MISSION, tmp_path / "search.yaml")
    async with in_the_studio(endpoint, tmp_path, mission=mission, simulated=False) as studio:
        command = [sys.executable, str(CAMERA), "uav1/victim", endpoint]
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
