"""The manifest of a robot, whichever form it is written in."""

from __future__ import annotations

from pathlib import Path

from bridged.drivers import check_manifest
from schemas.files.findings import Finding, Findings
from schemas.manifest.loader import Manifest, load_manifest


def load_robot_manifest(named: str | tuple[str, ...], folder: Path) -> Manifest:
    """Read what a mission names: a shipped manifest, a TOML file, or the paper's pair of INI files, actions first.

    Raises Findings with every problem, each at its line; where there are any, also with those that the drivers see.
    """
    if isinstance(named, str):
        return load_manifest(named, folder, check_manifest)
    if len(named) != 2:
        said = f"expected one manifest, or two: [actions_manifest, perceptions_manifest]; got {len(named)}"
        raise Findings([Finding(named[0] if named else "", 0, 0, said)])
    from bridged.paper_format.ini_manifests import (
        load_ini_pair,  # the vocabulary of mavros is memory that others need not have
    )

    return load_ini_pair(folder / named[0], folder / named[1])
