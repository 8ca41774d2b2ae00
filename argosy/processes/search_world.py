"""What a simulated copter meets in the mission's world, and where it writes what it did: for the referee."""

from __future__ import annotations

from pathlib import Path

from bridged.simulation.copter.world import Area, Victim, victims_of
from schemas.files.findings import Finding
from schemas.mission.model import Mission, World

SIGHTINGS = "victim"
"""The key on which a camera tells what it sees, behind the robot's prefix."""


def victims(world: World) -> list[Victim]:
    """Return the victims of a mission's world. Raises ValueError if it has no room for them."""
    return victims_of(world.seed, world.victims, Area(*world.area))


def servo_log(folder: Path, robot: str) -> Path:
    """Return the file in which a robot's simulator writes what its servo outputs did."""
    return folder / f"{robot}.servo.jsonl"


def log_arguments(name: str, folder: Path | None) -> list[str]:
    """Return what a copter's simulator is told of its servo log, if there is a folder for it."""
    return ["--servo-log", str(servo_log(folder, name))] if folder is not None else []


def camera_arguments(mission: Mission, name: str, router: str) -> list[str]:
    """Return what a copter's simulator is told of its camera; nothing if it has none."""
    robot, world = mission.robots[name], mission.world
    if robot.simulate is None or robot.simulate.camera is None or world is None:
        return []
    key = f"{robot.prefix}/{SIGHTINGS}" if robot.prefix else SIGHTINGS
    seen = ",".join(map(repr, (world.victims, world.seed, *world.area)))
    return [f"--victims={seen}", f"--camera={robot.simulate.camera:g}", f"--camera-key={key}", f"--router={router}"]


def check_world(mission: Mission) -> list[Finding]:
    """Return what is wrong with the world and with the cameras that look at it."""
    findings: list[Finding] = []
    if mission.world is not None:
        try:
            victims(mission.world)
        except ValueError as error:
            findings.append(mission.positions.finding(("world",), f"world: {error}"))
    for name, robot in mission.robots.items():
        if mission.world is None and robot.simulate is not None and robot.simulate.camera is not None:
            text = "simulate.camera: the mission has no `world` to look at"
            findings.append(mission.positions.finding(("robots", name, "simulate", "camera"), text))
    return findings
