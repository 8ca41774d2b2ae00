"""Actions that a program asks of a simulated vehicle whose autopilot is known not to have them."""

from __future__ import annotations

from collections.abc import Iterator

from agentd.check.finding_kinds import Kind, finding
from agentd.check.symbol_table import Survey
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable, simulated_table
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.mission.model import Robot


def check_autopilot(survey: Survey, manifest: Manifest, robot: Robot) -> Iterator[Finding]:
    """Yield a warning for each action of a program that the robot's simulated autopilot would refuse."""
    if robot.simulate is None or manifest.robot.driver != "mavlink":
        return
    modes = simulated_table(robot.simulate.autopilot, manifest.robot.vehicle)
    for mention in survey.actions:
        entry = manifest.actions.get(mention.name)
        if entry is not None and (why := _refused(entry, modes)):
            text = f"the action {mention.name}: {robot.simulate.autopilot} {why}"
            yield finding(Kind.UNAVAILABLE_ACTION, mention.position, text, "warning")


def _refused(entry: ActionEntry, modes: ModeTable) -> str:
    if entry.confirm == "orbit" and modes.orbit is None:
        return f"has no command by which a {modes.vehicle} flies a circle"
    return ""
