"""What the autopilot looks at several times a second: the pilot, the ground station, the fence, the battery."""

from typing import TYPE_CHECKING

from bridged.simulation.copter.battery import HOME_RADIUS, Shortage
from bridged.simulation.copter.boot import Milestone
from bridged.simulation.copter.failsafe_conditions import StationLink
from bridged.simulation.copter.flight_modes import Mode
from bridged.simulation.copter.protocol.notifications import Severity

if TYPE_CHECKING:
    from bridged.simulation.copter.copter import Copter

_LAND_ON_FAILSAFE = (1, 4)
PREARM_SAID_EVERY = 30.0
"""Vehicle seconds (ArduPilot: PREARM_DISPLAY_PERIOD)."""
_TERMINATE = 5
"""Values of BATT_FS_LOW_ACT and BATT_FS_CRT_ACT; others but 0 bring the copter home."""


def watch_over(copter: "Copter", dt: float) -> None:
    """One look; the one before was `dt` vehicle seconds ago."""
    _pilot(copter)
    _station(copter)
    _fence(copter)
    _battery(copter, dt)
    _arming(copter, dt)
    said = copter.outputs.step(copter.now)
    if said is not None:
        copter.say(said)


def _pilot(copter: "Copter") -> None:
    pilot = copter.transmitter
    if not pilot.touched:
        return
    wanted = pilot.switched_mode(copter.now)
    if wanted is not None and copter.passed(Milestone.MODE_SWITCH):
        copter.set_mode(wanted)
    if copter.mode.piloted and copter.flight.airborne:
        drift = pilot.drift(copter.motion.heading, copter.now)
        if drift is not None:
            copter.flight.begin(drift)


def _station(copter: "Copter") -> None:
    change = copter.station.check(copter.now, armed=copter.armed)
    if change is StationLink.LOST:
        if copter.flight.airborne:
            copter.bring_home()
        copter.say(change.value, Severity.WARNING)
    elif change is StationLink.FOUND:
        copter.say(change.value, Severity.WARNING)


def _fence(copter: "Copter") -> None:
    fence = copter.fence
    breach = fence.breach(copter.motion.position, copter.home_on_chart) if copter.flight.airborne else None
    if not fence.notice(breach, copter.now):
        return
    copter.say(f"{breach} fence breached", Severity.WARNING)
    match int(copter.parameters["FENCE_ACTION"]):
        case 0:
            return
        case 2:
            copter.set_mode(Mode.LAND)
        case 4:
            copter.set_mode(Mode.BRAKE)
        case _:
            copter.bring_home()


def _arming(copter: "Copter", dt: float) -> None:
    """What a fault makes of the arming checks is said again and again while the motors are off."""
    if copter.hindrance and not copter.armed and copter.now % PREARM_SAID_EVERY < dt:
        copter.say(f"PreArm: {copter.hindrance}", Severity.CRITICAL)


def _battery(copter: "Copter", dt: float) -> None:
    battery, flight = copter.battery, copter.flight
    if not copter.armed and not flight.airborne and copter.home is not None:
        away = copter.motion.position.distance(copter.home_on_chart)
        battery.rest(dt, at_home=away <= HOME_RADIUS)
    shortage = battery.check(copter.now)
    if shortage is None:
        return
    name = shortage.name.lower()
    copter.say(f"Battery 1 is {name} {battery.voltage:.2f}V used {battery.used:.0f} mAh", Severity.WARNING)
    action = int(copter.parameters["BATT_FS_LOW_ACT" if shortage is Shortage.LOW else "BATT_FS_CRT_ACT"])
    if not copter.armed or action == 0:
        return
    copter.say("Battery Failsafe", Severity.WARNING)
    if not flight.airborne or action == _TERMINATE:
        copter.disarm(force=True)
    elif action in _LAND_ON_FAILSAFE:
        copter.set_mode(Mode.LAND)
    else:
        copter.bring_home()
