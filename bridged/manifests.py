"""The manifest of a robot, whichever form it is written in."""

from __future__ import annotations

from pathlib import Path

from schemas.findings import Finding, Findings
from schemas.manifest import Manifest, load_manifest


def load_robot_manifest(named: str | tuple[str, str], folder: Path) -> Manifest:
    """Read what a mission names: a shipped manifest, a TOML file, or the paper's pair of INI files.

    Raises Findings with every problem, each at its line.
    """
    if isinstance(named, str):
        return load_manifest(named, folder)
    raise Findings([Finding(named[0], 0, 0, "INI manifests are not read yet")])
