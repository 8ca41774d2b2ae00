"""The arming checks: why the motors may not start."""

from typing import TYPE_CHECKING

from bridged.simulation.copter.boot import Milestone

if TYPE_CHECKING:
    from bridged.simulation.copter.copter import Copter


def arming_problems(copter: "Copter") -> list[str]:
    """Why the motors cannot be armed now, in the vehicle's words; none if they can."""
    if not copter.passed(Milestone.READY):
        return ["System not initialised"]
    if not copter.passed(Milestone.EKF_YAW):
        return ["Need Alt Estimate"]
    if not copter.passed(Milestone.ACCELS_AGREE):
        return ["Accels inconsistent"]
    problems = [copter.hindrance] if copter.hindrance else []
    if not copter.passed(Milestone.HOME):
        problems.append("AHRS: waiting for home")
    if not copter.passed(Milestone.GYROS_AGREE):
        problems.append("Gyros inconsistent")
    if not copter.mode.armable:
        problems.append(f"{copter.mode.name} mode not armable")
    elif copter.mode.needs_position and not copter.passed(Milestone.POSITION):
        problems.append("Need Position Estimate")
    if copter.home is not None and copter.fence.breach(copter.motion.position, copter.home_on_chart):
        problems.append("vehicle outside fence")
    if copter.battery.shortage or copter.battery.empty:
        problems.append("Battery failsafe")
    return problems
