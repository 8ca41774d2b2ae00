"""Read and check everything that a bridge needs, before anything starts."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import get_args

from msgspec.structs import replace

from bridged.bridge.safety_orders import STEP_FIELDS, Step, read_steps
from bridged.drivers.api import Order
from bridged.drivers.registry import check_manifest, check_robot, load_robot_manifest, orders_of
from schemas.files.findings import Finding, Findings, did_you_mean
from schemas.files.yaml_positions import Steps
from schemas.manifest.loader import Manifest
from schemas.mission.model import NO_STEPS, Mission


@dataclass(frozen=True)
class RobotSetup:
    """What was read of one robot of a bridge."""

    name: str
    manifest: Manifest
    steps: tuple[Step, ...]
    """For the loss of its agent."""
    idle_steps: tuple[Step, ...]
    """For a robot in the air whose agents intend nothing."""
    agents: list[str]
    where: str
    """Its link, or the prefix of its keys, or its driver, for people."""


def chosen(mission: Mission, robots: list[str], board: str | None) -> list[str]:
    """Return the robots that a bridge serves: those that are named, or all of the board. Raises Findings for none."""
    if robots:
        return robots
    if board is None and len(mission.boards) > 1:
        raise Findings([_said(mission, f"which robots? Name them, or by --board one of {', '.join(mission.boards)}")])
    if board is not None and board not in mission.board_names:
        raise Findings([_said(mission, f"there is no board `{board}`{did_you_mean(board, mission.boards)}")])
    found = [name for name, robot in mission.robots.items() if board in (None, robot.board)]
    if not found:
        raise Findings([_said(mission, f"board `{board}` has no robots" if board else "the mission has no robots")])
    return found


def _said(mission: Mission, text: str) -> Finding:
    return Finding(str(mission.path), 0, 0, text)


def prepare_all(mission: Mission, names: list[str], link: str | None, speed: float) -> tuple[Mission, list[RobotSetup]]:
    """Prepare several robots of one bridge. `speed`: mission seconds per wall second.

    Raises Findings with what is wrong with any of them.
    """
    parts: list[RobotSetup] = []
    findings: list[Finding] = []
    for name in dict.fromkeys(names):
        try:
            mission, part = prepare(mission, name, link, speed)
            parts.append(part)
            served = replace(mission.robots[name], simulate=None)  # who simulates a vehicle finds its link before
            problems = (problem for _, problem in check_robot(part.manifest, served))
            findings += [mission.positions.finding(("robots", name), f"{name} {problem}") for problem in problems]
        except Findings as found:
            findings += found.findings
    if findings:
        raise Findings(findings)
    return mission, parts


def prepare(mission: Mission, name: str, link: str | None, speed: float) -> tuple[Mission, RobotSetup]:
    """Read and check everything of one robot, with `link` in place of the mission's. Raises Findings with all of it."""
    robot = mission.robots.get(name)
    if robot is None:
        known = ", ".join(mission.robots) or "none"
        raise Findings([mission.positions.finding(("robots",), f"there is no robot `{name}`, there is {known}")])
    findings: list[Finding] = []
    where = ("robots", name)
    if speed != 1 and robot.simulate is None:
        findings.append(
            mission.positions.finding(where, f"speed {speed:g}: only a simulated robot can have another speed than 1")
        )
    steps: dict[str, tuple[Step, ...]] = {}
    for field in STEP_FIELDS:
        try:
            steps[field] = read_steps(mission, name, field)
        except Findings as found:
            findings += found.findings
    manifest: Manifest | None = None
    try:
        manifest = load_robot_manifest(robot.manifest, mission.path.parent)
        findings += [*check_manifest(manifest), *order_findings(mission, name, manifest)]
    except Findings as found:
        findings += found.findings
    robot = replace(robot, link=link or robot.link)
    if robot.signing is not None:
        passphrase = mission.relative(robot.signing.passphrase_file).absolute()
        robot = replace(robot, signing=replace(robot.signing, passphrase_file=str(passphrase)))
    for key, problem in () if manifest is None else check_robot(manifest, robot):
        place = (*where, key) if (*where, key) in mission.positions.values else where
        findings.append(mission.positions.finding(place, problem))
    if findings or manifest is None:
        raise Findings(findings)
    part = RobotSetup(
        name,
        manifest,
        steps["on_agent_loss"],
        steps["on_idle"],
        mission.agents_of(name),
        robot.link or (f"{robot.prefix}/**" if robot.prefix else f"driver `{manifest.robot.driver}`"),
    )
    return dataclasses.replace(mission, robots=mission.robots | {name: robot}), part


def order_findings(mission: Mission, name: str, manifest: Manifest) -> list[Finding]:
    """Return findings for orders that the mission declares (defaults apart) and the robot does not have."""
    robot, positions, known = mission.robots[name], mission.positions, orders_of(manifest)
    if known is None:
        return []
    said: list[tuple[Steps, str]] = [(("robots", name, "on_shutdown"), robot.on_shutdown)]
    for field, steps in (("on_agent_loss", robot.on_agent_loss), ("on_idle", robot.on_idle)):
        if steps != NO_STEPS:
            said += [(("robots", name, field, index), step.partition(" ")[0]) for index, step in enumerate(steps)]
    has = ", ".join(sorted(known)) or "none; its manifest declares them under [orders]"
    return [
        positions.finding(where, f"{where[2]}: the robot has no order `{order}`, it has {has}")
        for where, order in said
        if where in positions.values and order in get_args(Order) and order not in known
    ]
