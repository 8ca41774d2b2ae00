"""What must be said of a vehicle that is, or may be, in the air when nobody watches it any more."""

from __future__ import annotations

from argosy.fleet_model.robots import RobotSeen
from argosy.run.run_status import Status
from schemas.liveness import STALE_AFTER

ON_GROUND = 0.5
"""Metres above home up to which an armed vehicle is not called flying."""
TAKE_OVER = "take over with the transmitter or ground station"


def in_the_air(status: Status) -> list[str]:
    """Return one line for each vehicle that was armed when it was last seen, as its bridge left it."""
    return [_line(status, robot) for robot in status.picture.robots.values() if _maybe_flying(status, robot)]


def left_alone(status: Status, robot: RobotSeen) -> bool:
    """Whether a vehicle is armed, or was when it was last seen, and its bridge has not left it to a pilot."""
    left = status.left.get(robot.name)
    return _maybe_flying(status, robot) and (left is None or left.state != "piloted" or robot.lost)


def last_line(status: Status, robot: str) -> str:
    """Return what is left to bring a vehicle home without its bridge."""
    if status.setup.mission.robots[robot].failsafe.watches:
        return f"its own failsafe is the last line; {TAKE_OVER}"
    return f"nothing brings it home: {TAKE_OVER}"


def age(status: Status, robot: RobotSeen) -> float:
    """Return how old what is known of a vehicle is, in mission seconds, if its bridge says nothing; 0 otherwise."""
    old = status.now() - status.picture.heard_of(robot)
    return old if robot.connected and old > STALE_AFTER * status.setup.speed else 0.0


def _maybe_flying(status: Status, robot: RobotSeen) -> bool:
    left = status.left.get(robot.name)
    landed_since = left is not None and left.state == "disarmed" and not robot.lost
    return robot.armed and not landed_since


def _line(status: Status, robot: RobotSeen) -> str:
    name, left = robot.name, status.left.get(robot.name)
    order = left.order if left is not None else None
    where = "ARMED" if robot.altitude is not None and robot.altitude < ON_GROUND else "IN THE AIR"
    if left is not None:
        how = f"{order.upper()} confirmed by its bridge" if order else f"its bridge says: {left.text}"
    elif name in status.killed:
        how = "its bridge did not leave and was killed, no order was confirmed"
    else:
        how = "its bridge is dead, no order was confirmed"
    if name not in status.setup.real:
        return f"{name} WAS STILL {where}: {how}; it is simulated and ended with the run"
    if left is not None and left.state == "piloted" and not robot.lost:
        return f"{name} IS STILL {where}: {left.text}; nobody else watches it now"
    if order and not robot.lost:
        return f"{name} IS STILL {where}: {how}; nobody watches it now"
    ago = f"last heard {status.now() - status.picture.heard_of(robot):.0f} s ago, {robot.last_known()}"
    return f"{name} MAY STILL BE {where}: {ago}; {how}; {last_line(status, name)}"
