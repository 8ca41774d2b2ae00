"""Warnings about vehicles that are, or may be, in the air when the run no longer watches them."""

from __future__ import annotations

from argosy.fleet_model.members import FleetRobot
from argosy.fleet_model.robots import AIRBORNE
from argosy.run.run_status import Status

TAKE_OVER = "take over with the transmitter or ground station"


def in_the_air(status: Status) -> list[str]:
    """Return one line for each vehicle that was armed when it was last seen, as its bridge left it."""
    return [_line(status, robot) for robot in status.robots.values() if _maybe_flying(status, robot)]


def left_alone(status: Status, robot: FleetRobot) -> bool:
    """Whether a vehicle is armed, or was when it was last seen, and its bridge has not left it to a pilot."""
    left = status.left.get(robot.name)
    return _maybe_flying(status, robot) and (left is None or left.state != "piloted" or robot.seen.lost)


def last_line(status: Status, robot: str) -> str:
    """Return how a vehicle comes home without its bridge, as text."""
    if status.setup.mission.robots[robot].failsafe.watches:
        return f"only its own failsafe brings it home: {TAKE_OVER}"
    return f"nothing brings it home: {TAKE_OVER}"


def age(status: Status, robot: FleetRobot) -> float:
    """Return how old the state of a connected vehicle is, in mission seconds, if its bridge is silent; 0 otherwise."""
    now = status.model.now()
    return status.mission_seconds(robot.age(now) or 0.0) if robot.seen.connected and robot.stale(now) else 0.0


def _maybe_flying(status: Status, robot: FleetRobot) -> bool:
    left = status.left.get(robot.name)
    landed_since = left is not None and left.state == "disarmed" and not robot.seen.lost
    return robot.seen.armed and not landed_since


def _line(status: Status, robot: FleetRobot) -> str:
    name, seen, left = robot.name, robot.seen, status.left.get(robot.name)
    order = left.order if left is not None else None
    where = "ARMED" if seen.altitude is not None and seen.altitude <= AIRBORNE else "IN THE AIR"
    if left is not None:
        how = f"{order.upper()} confirmed by its bridge" if order else f"its bridge reports: {left.text}"
    elif name in status.killed:
        how = "its bridge did not leave and was killed, no order was confirmed"
    else:
        how = "its bridge reports nothing, no order was confirmed"
    if name not in status.setup.real:
        return f"{name} WAS STILL {where}: {how}; it is simulated and ended with the run"
    if left is not None and left.state == "piloted" and not seen.lost:
        return f"{name} IS STILL {where}: {left.text}; nobody else watches it now"
    if order and not seen.lost:
        return f"{name} IS STILL {where}: {how}; nobody watches it now"
    old = status.mission_seconds(robot.age(status.model.now()) or 0.0)
    ago = f"last heard {old:.0f} s ago, {seen.last_known()}"
    return f"{name} MAY STILL BE {where}: {ago}; {how}; {last_line(status, name)}"
