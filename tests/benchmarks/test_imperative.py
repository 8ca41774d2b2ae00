"""The imperative programs: a mission that has them in the place of its agents."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.flights import programs, variant
from benchmarks.results import ROOT
from schemas.mission.model import load_mission


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
