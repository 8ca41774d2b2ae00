"""Find files that ship with the project besides its code, in a checkout or an installed wheel."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

Kind = Literal["manifests", "missions", "deploy"]
"""Manifests of robots, missions with their programs, and templates for boards."""
_PACKAGE = Path(__file__).resolve().parents[1]
_BASES = (_PACKAGE / "shipped", _PACKAGE.parent)


def shipped(kind: Kind, name: str) -> Path | None:
    """Return the path of the shipped file `name` (`copter.toml`), or None if none ships under that name."""
    for base in _BASES:
        path = base / kind / name
        if path.is_file():
            return path
    return None


def shipped_names(kind: Kind, suffix: str) -> list[str]:
    """Return the names of the shipped files, without suffix, for error messages."""
    return sorted({path.stem for base in _BASES for path in (base / kind).glob(f"*{suffix}")})


def mission_file(named: str | Path) -> Path:
    """Return the file of a mission: a path, or the bare name of a shipped mission if there is no such file."""
    path = Path(named)
    if path.suffix or path.name != str(named) or path.is_file():
        return path
    return shipped("missions", f"{named}.yaml") or path
