"""Commands on the bus of an operator who names another mission than the one that runs."""

import asyncio
from pathlib import Path

import pytest

from argosy.__main__ import main
from tests.support.buses import FLEET, Connect


@pytest.mark.parametrize("command", [("status", "--wait", "0.2"), ("mail",), ("stop", "hold")])
async def test_the_fleet_that_runs_is_named_where_that_of_the_mission_does_not(
    command: tuple[str, ...], connect: Connect, endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission = tmp_path / "other.yaml"
    mission.write_text("mission: other\nagents: {a: {program: a.asl}}\nrobots: {uav1: {manifest: copter}}\n")
    await (await connect("uav1", daemon="bridged")).claim("uav1")
    assert await asyncio.to_thread(main, [*command, "--mission", str(mission), "--router", endpoint]) == 1
    note = f"note: nobody of fleet `other` is on the bus at {endpoint}; there is fleet `{FLEET}`\n"
    assert note in capsys.readouterr().err
