"""The imperative programs: started in the place of agents, and flown by real daemons."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks.flights import SINGLE, flying, setup_in, start_all, with_programs
from benchmarks.imperative.plan import programs, variant
from benchmarks.processes import BenchmarkFailed
from benchmarks.results import ROOT
from benchmarks.watched import Watched
from schemas.mission.model import load_mission

SPEED = 20


def test_the_mission_is_flown_to_its_end() -> None:
    with flying(SINGLE, "python", SPEED) as flight:
        with pytest.raises(BenchmarkFailed, match="not done after"):
            flight.until_done(patience=0.1)
        flight.until_done(120)
        uav, bridge = _of(flight.watched, "program"), _of(flight.watched, "bridged")
        assert uav.process.wait(20) == 0
        bridge.says("return_to_launch succeeded")
        told = "\n".join(_lines(bridge) + _lines(uav))
        said = ["uav up", "taking off to 5 m", "flying to [-27.603683, -48.518052, 40]", "returning to home"]
        assert [line for line in _lines(uav) if line in said] == said, told
        actions = [line.split()[-2] for line in _lines(bridge) if line.endswith(" succeeded")]
        assert actions == ["set_mode", "arm_motors", "takeoff", "goto", "return_to_launch"], told
    assert all(watched.process.returncode is not None for _, watched in flight.watched), "nothing is left behind"


def test_a_waypoint_that_is_not_reached_brings_the_vehicle_home() -> None:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)))
        setup = setup_in(folder, SINGLE.mission, SPEED)
        file = setup.mission.path
        file.write_text(file.read_text().replace("-48.518052, 40)", "-48.518052, 90)"))  # the limit is 60 m
        _, planned, _ = with_programs(replace(setup, mission=load_mission(file)), folder)
        watched: list[Any] = []
        start_all(stack, planned, watched)
        uav, bridge = _of(watched, "program"), _of(watched, "bridged")
        assert uav.process.wait(120) == 1
        uav.says("mission failed: altitude 90 m is above the mission's limit of 60 m")
        assert _lines(uav)[-1] == "ordering return_to_launch"
        bridge.says("return_to_launch succeeded")


def _of(watched: list[Any], kind: str) -> Watched:
    return next(one for process, one in watched if process.kind.name == kind)


def _lines(watched: Watched) -> list[str]:
    return [line for _, line in watched.said]


def test_the_variant_of_a_mission_has_programs_where_it_had_agents_and_is_the_same_else(tmp_path: Path) -> None:
    original = load_mission(ROOT / "missions" / "search_and_rescue.yaml")
    file = variant(original.path, tmp_path, speed=7)
    mission = load_mission(file)
    assert mission.agents == {}
    assert {name: (one.board, one.robot) for name, one in mission.clients.items()} == {
        name: (one.board, one.robot) for name, one in original.agents.items()
    }
    for field in ("name", "fleet", "boards", "timeout", "world", "mail", "radio", "router"):
        assert getattr(mission, field) == getattr(original, field)
    assert mission.speed == 7
    for name, robot in mission.robots.items():
        assert Path(robot.manifest).is_file()
        assert replace_manifest(robot) == replace_manifest(original.robots[name])


def replace_manifest(robot: Any) -> dict[str, Any]:
    return {field: getattr(robot, field) for field in robot.__struct_fields__ if field != "manifest"}


def test_beliefs_of_agents_become_settings_of_programs(tmp_path: Path) -> None:
    original = load_mission(ROOT / "missions" / "search_and_rescue.yaml")
    scout, rescuer, _ = programs(original, tmp_path / "m.yaml", lambda board: f"tcp/{board}")
    assert rescuer.argv[-7:] == (
        str(tmp_path / "m.yaml"), "rescuer1", "tcp/pi2", "height=10", 'scout="scout"', 'peers=["rescuer2"]',
        "battery_low=40",
    )  # fmt: skip
    assert "area=[-27.603853, -48.5193, -27.602955, -48.5173]" in scout.argv


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["scout", "nowhere.yaml", "scout", "tcp/127.0.0.1:7", "height=10"], "nowhere.yaml: error: cannot be read"),
        (["scout", "missions/single_uav.yaml", "uav", "tcp/127.0.0.1:7"], "`uav` is an agent of the mission"),
        (["scout", "m.yaml", "scout", "tcp/127.0.0.1:7", "height"], "argument NAME=JSON: invalid setting value"),
    ],
)
def test_a_program_that_cannot_be_started_says_why(arguments: list[str], said: str) -> None:
    command = [sys.executable, "-m", "benchmarks.imperative", *arguments]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert run.returncode == 2
    assert said in run.stderr.splitlines()[-1]
