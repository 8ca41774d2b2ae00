"""Reads and checks everything that a bridge needs, before anything starts."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

from msgspec.structs import replace

from bridged.drivers import check_link, check_manifest
from bridged.orders import Step, read_steps
from schemas.findings import Finding, Findings
from schemas.manifest import Manifest, load_manifest
from schemas.mission import Mission


def prepare(mission: Mission, name: str, link: str | None, speed: float) -> tuple[Mission, Manifest, tuple[Step, ...]]:
    """Read everything that can be wrong before anything starts. Raises Findings with all of it."""
    robot = mission.robots.get(name)
    if robot is None:
        known = ", ".join(mission.robots) or "none"
        raise Findings([mission.positions.finding(("robots",), f"there is no robot `{name}`, there is {known}")])
    findings: list[Finding] = []
    where = ("robots", name)
    if speed != 1 and robot.simulate is None:
        findings.append(mission.positions.finding(where, f"speed {speed:g}: only a simulated robot can be hurried"))
    manifest: Manifest | None = None
    steps: tuple[Step, ...] = ()
    try:
        steps = read_steps(mission, name)
    except Findings as found:
        findings += found.findings
    try:
        if not isinstance(robot.manifest, str):
            raise Findings([mission.positions.finding((*where, "manifest"), "INI manifests are not read yet")])
        manifest = load_manifest(robot.manifest, mission.path.parent)
        findings += check_manifest(manifest)
    except Findings as found:
        findings += found.findings
    robot = replace(robot, link=link or robot.link)
    try:
        if manifest is not None:
            check_link(manifest, robot.link)
    except ValueError as error:
        findings.append(mission.positions.finding((*where, "link"), str(error)))
    if findings or manifest is None:
        raise Findings(findings)
    return dataclasses.replace(mission, robots=mission.robots | {name: robot}), manifest, steps


def state_directory(given: Path | None) -> Path:
    """Where a bridge keeps what must outlive it: `--state`, or XDG_STATE_HOME, or its default below the home."""
    if given is not None:
        return given
    base = os.environ.get("XDG_STATE_HOME") or (Path.home() / ".local" / "state" if "HOME" in os.environ else ".")
    return Path(base) / "argosy"
