"""What a mission file names (programs and manifests), read leniently.

So that a mistake in the mission file does not hide the mistakes in the files that it names: `load_mission` decides
whether the mission is right, this only says what there is to be read.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from schemas.files.findings import Findings
from schemas.files.text_files import read_bounded
from schemas.files.yaml_positions import Positions, read_yaml


@dataclass(frozen=True)
class AgentOutline:
    """An agent's program, robot and beliefs."""

    program: str
    robot: str | None
    beliefs: tuple[str, ...]


@dataclass(frozen=True)
class Outline:
    """What a mission file names."""

    agents: dict[str, AgentOutline]
    robots: dict[str, str | tuple[str, str]]
    """Each robot's manifest: a name, or the pair of INI files."""
    positions: Positions
    folder: Path
    """What paths in the mission are relative to."""


def outline(path: Path) -> Outline | None:
    """Return what a mission file names; None if it is not even YAML."""
    try:
        raw, positions = read_yaml(read_bounded(path).decode(), str(path))
    except (Findings, OSError, UnicodeDecodeError):
        return None
    if not isinstance(raw, dict):
        return None
    agents = {
        name: AgentOutline(
            values["program"],
            robot if isinstance(robot := values.get("robot"), str) else None,
            _texts(values.get("beliefs")),
        )
        for name, values in _mapping(raw.get("agents")).items()
        if isinstance(values, dict) and isinstance(values.get("program"), str)
    }
    robots: dict[str, str | tuple[str, str]] = {}
    for name, values in _mapping(raw.get("robots")).items():
        manifest = values.get("manifest") if isinstance(values, dict) else None
        if isinstance(manifest, str):
            robots[name] = manifest
        elif len(pair := _texts(manifest)) == 2:
            robots[name] = (pair[0], pair[1])
    return Outline(agents, robots, positions, path.parent)


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(item for item in value if isinstance(item, str)) if isinstance(value, list) else ()


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
