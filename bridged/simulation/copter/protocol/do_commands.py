"""What a copter does besides flying: the same whether a command says it or an item of its mission."""

import math
from typing import TYPE_CHECKING

from bridged.simulation.copter import mission
from bridged.simulation.copter.flight_modes import Mode
from bridged.simulation.copter.protocol.command_results import Result
from bridged.simulation.copter.servo_outputs import Grip

if TYPE_CHECKING:
    from bridged.simulation.copter.copter import Copter


def do(copter: "Copter", command: int, params: tuple[float, float, float, float]) -> Result:
    """Carries out one command (MAV_CMD) of `mission.DEEDS`."""
    first, second, third, fourth = params
    match command:
        case mission.CHANGE_SPEED:
            return _change_speed(copter, first, second)
        case mission.CONDITION_YAW:
            return _turn(copter, first, third, relative=fourth == 1.0)
        case mission.SET_HOME:
            copter.set_home(copter.place)
        case mission.FENCE_ENABLE:
            if first not in (0.0, 1.0):
                return Result.FAILED
            copter.parameters.set("FENCE_ENABLE", first)
        case mission.SET_SERVO:
            return _unless(copter, copter.outputs.set(whole(first), whole(second)))
        case mission.REPEAT_SERVO:
            problem = copter.outputs.repeat(whole(first), whole(second), whole(third), fourth, copter.now)
            return _unless(copter, problem)
        case mission.GRIPPER:
            return _grip(copter, second)
    return Result.ACCEPTED


def whole(value: float) -> int:
    """A whole number from a field that any sender can fill with anything; -1 for what is none."""
    return int(value) if math.isfinite(value) and abs(value) < 2**31 else -1


def _change_speed(copter: "Copter", kind: float, speed: float) -> Result:
    """m/s over the ground, until another mode."""
    if kind not in (0.0, 1.0) or not 0.2 <= speed <= 50:
        return Result.FAILED
    copter.flight.cruise_speed = speed
    return Result.ACCEPTED


def _turn(copter: "Copter", angle: float, direction: float, *, relative: bool) -> Result:
    """Degrees from north, or from where the nose points."""
    if copter.mode not in (Mode.GUIDED, Mode.AUTO) or not 0 <= angle <= 360:
        return Result.FAILED
    heading = math.radians(angle)
    if relative:
        heading = copter.motion.heading + (heading if direction >= 0 else -heading)
    copter.flight.heading_wish = heading % (2 * math.pi)
    return Result.ACCEPTED


def _grip(copter: "Copter", action: float) -> Result:
    if copter.parameters["GRIP_ENABLE"] < 1:
        return Result.FAILED
    if action not in (0.0, 1.0):
        return Result.DENIED
    copter.say(copter.outputs.grip(Grip(int(action)), copter.now))
    return Result.ACCEPTED


def _unless(copter: "Copter", problem: str | None) -> Result:
    if problem is None:
        return Result.ACCEPTED
    copter.say(problem)
    return Result.FAILED
