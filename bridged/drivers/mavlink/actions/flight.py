"""How each action is carried out and its success confirmed by the vehicle's state (design section 5).

An acknowledgement starts the wait for the state or ends it with a refusal; it never is the success. Each procedure is
a generator: the session resumes it on every message and tick, so it runs in virtual time and needs no clock.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Generator
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, defers
from bridged.drivers.mavlink.actions.arrival import arrive, check_placed
from bridged.drivers.mavlink.actions.confirmation import (
    SLOW,
    TARGET_ATTEMPTS,
    above_home,
    acknowledged,
    check_guided_aloft,
    check_limits,
    comes_true,
    down,
    enter,
    from_home,
    home_reported,
    home_reported_for_limits,
    metres,
    own_target,
    parked,
    ready,
    steady,
    target_is,
    target_shown,
    target_taken,
)
from bridged.drivers.mavlink.actions.context import (
    SUCCEEDED,
    BoundAction,
    Ended,
    Part,
    Procedure,
    ProcedureContext,
    ProcedureRun,
    Steps,
    mode_action,
)
from bridged.drivers.mavlink.actions.mission_actions import download, mission_protocol
from bridged.drivers.mavlink.actions.parameters import read_parameter, write_parameter
from bridged.drivers.mavlink.vehicle.state import OFF_GROUND

HOLD_EVERY = (2.0, 1.0)
"""Mission and wall seconds between two attempts to make a vehicle stay where it is."""
LIFT_OFF_WITHIN = (15.0, 3.0)
"""Mission and wall seconds in which an acknowledged takeoff must leave the ground."""

log = logging.getLogger("mavlink")


def arm(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """COMPONENT_ARM_DISARM: waits until the vehicle is ready, then arms it; the state shows it at two HEARTBEATs."""
    wanted = action.parameters[0] == 1.0
    if wanted and (other := flight.vehicle.contradiction):
        return Outcome("refused", other)
    if wanted and not flight.vehicle.armed:
        if flight.vehicle.mode in flight.vehicle.modes.at_arming:
            reason = f"armed in {flight.vehicle.mode_name} the vehicle would move by itself; set another mode first"
            return Outcome("refused", reason)
        yield from ready(flight, run)

    def shown() -> bool:
        return flight.vehicle.armed == wanted

    asked = flight.now
    command = flight.submit(run, action)
    yield from acknowledged(flight, run, command, shown)
    run.waits_for = f"a HEARTBEAT that shows {'armed' if wanted else 'not armed'}"
    if (yield from steady(flight, shown)):
        return SUCCEEDED
    reason = f"{command.name} was acknowledged, but the vehicle is {'not armed' if wanted else 'still armed'}"
    return Outcome("failed", flight.with_texts(reason, asked))


def take_off(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """NAV_TAKEOFF: within the tolerance of the altitude above home.

    In the air and not above that it climbs on: a takeoff was paused there, or its agent or bridge was restarted.
    """
    vehicle, wanted, near = flight.vehicle, action.parameters[6], action.tolerance or 0.3
    if broken := flight.too_high(wanted):
        return Outcome("refused", broken, "limits")
    if vehicle.aloft and vehicle.placed:
        return (yield from _climb_on(flight, run, action, near))
    aloft_before = vehicle.aloft
    ground = vehicle.position.altitude if vehicle.position is not None else 0.0

    def rising() -> bool:
        climbed = vehicle.position is not None and vehicle.armed and vehicle.position.altitude > ground + OFF_GROUND
        return (vehicle.aloft or climbed) and not aloft_before

    asked, run.judges_mode = flight.now, flight.autopilot.settles > 0
    command = flight.submit(run, flight.autopilot.takeoff(flight, action), may_repeat=lambda: not rising())
    yield from acknowledged(flight, run, command, rising)
    return (yield from _climb(flight, run, wanted, near, command.name, asked))


def take_off_by_mode(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`takeoff_by_mode`: TKOFF_ALT is set, TAKEOFF entered, and the altitude above home reached (planes).

    An autopilot with a command for it is given that one. One that is under way goes on, as after a death of its agent;
    after a pause in the air it climbs on by a target: entered again there, TAKEOFF may climb TKOFF_ALT from there.
    """
    vehicle, wanted = flight.vehicle, action.arguments["altitude"]
    mode = vehicle.modes.takeoff
    if mode is None or not isinstance(wanted, int | float):
        return Outcome("refused", f"a vehicle of this kind has no mode to take off by: {vehicle.modes.vehicle}")
    if broken := flight.too_high(float(wanted)):
        return Outcome("refused", broken, "limits")
    if not vehicle.armed:
        return Outcome("refused", f"a takeoff begins armed; {flight.state_text()}")
    near, asked = action.tolerance or 5.0, flight.now
    parameters = (0.0,) * 6 + (float(wanted),)
    command = BoundAction(
        dialect.MAV_CMD_NAV_TAKEOFF, parameters, retry=action.retry, tolerance=near, yaw=action.yaw, by_int=True
    )
    if vehicle.aloft:
        if vehicle.mode != mode:
            return (yield from _climb_on(flight, run, command, near))
        run.judges_mode = flight.autopilot.settles > 0
        known = None if flight.autopilot.settles else (yield from read_parameter(flight, run, "TKOFF_ALT"))
        if known is not None and abs(known.value - wanted) > near:
            return Outcome("refused", f"a takeoff to {known.value:g} m is under way; {flight.state_text()}")
        return (yield from _climb(flight, run, float(wanted), near, "the takeoff under way", asked))
    if flight.autopilot.settles:
        return (yield from take_off(flight, run, command))
    yield from write_parameter(flight, run, "TKOFF_ALT", float(wanted))
    asked = flight.now
    yield from enter(flight, run, mode_action(vehicle.modes, mode), mode)
    return (yield from _climb(flight, run, float(wanted), near, vehicle.modes.name(mode), asked))


def _climb_on(flight: ProcedureContext, run: ProcedureRun, action: BoundAction, near: float) -> Steps:
    """Continue a takeoff in the air, where NAV_TAKEOFF is refused: by a target above. It does not lead down."""
    vehicle, wanted, asked = flight.vehicle, action.parameters[6], flight.now
    if vehicle.position is None:
        return Outcome("refused", "the vehicle has not reported where it is")
    if vehicle.position.altitude > wanted + near and not flight.goes_on(action):
        reason = f"a takeoff to {wanted:g} m does not lead down from {vehicle.position.altitude:.1f} m"
        return Outcome("refused", f"{reason}; {flight.state_text()}")
    above = replace(vehicle.position, altitude=wanted)
    target = replace(action, target=above, frame=dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, limited=False)
    yield from target_taken(flight, run, target)
    return (yield from _climb(flight, run, wanted, near, "the target above", asked))


def _climb(flight: ProcedureContext, run: ProcedureRun, wanted: float, near: float, name: str, asked: float) -> Steps:
    """Wait until the altitude is reached; off the ground before long.

    An autopilot that ends a takeoff by itself does so a little beside the altitude, by the mode of `hold`: the same
    mode farther below is somebody else's. A position after the change of the mode judges that.
    """
    vehicle, seen, modes = flight.vehicle, flight.vehicle.positions, flight.vehicle.modes
    patience, by_itself = flight.now + flight.wait(*LIFT_OFF_WITHIN), max(near, flight.autopilot.settles)
    climbing, left_at = False, math.inf
    while True:
        check_placed(flight, asked)
        if vehicle.mode == modes.takeoff:
            climbing, left_at = True, math.inf
        elif climbing:
            left_at = min(left_at, vehicle.positions)
        if not vehicle.armed:
            return Outcome("failed", flight.with_texts("the vehicle disarmed before it was up", asked))
        if vehicle.position is not None and vehicle.positions > seen:
            climbed = vehicle.position.altitude
            run.feedback = {"altitude": round(climbed, 2), "to_go": round(wanted - climbed, 2)}
            run.waits_for = f"altitude {wanted:g} m; it is at {climbed:.1f} m"
            at_rest = vehicle.mode == modes.hold and vehicle.speed <= SLOW and flight.autopilot.settles > 0
            if abs(climbed - wanted) <= (by_itself if at_rest or vehicle.positions > left_at else near):
                if vehicle.mode == modes.takeoff:  # it will end it by itself
                    flight.expect_mode(modes.hold)
                if vehicle.mode in (*modes.targets, modes.takeoff) and not vehicle.failsafe_acts:
                    return SUCCEEDED
            if run.judges_mode and (vehicle.positions > left_at or vehicle.failsafe_acts):
                reason = f"at {climbed:.1f} m the mode became {vehicle.mode_name}, which nobody here asked for"
                return Outcome("failed", flight.with_texts(f"{reason} ({flight.others})", asked), "pilot")
        elif vehicle.positions == seen:
            run.waits_for = "a position from the vehicle"
        if not vehicle.aloft and flight.now > patience:
            reason = f"{name} was acknowledged, but the vehicle did not leave the ground"
            return Outcome("failed", flight.with_texts(reason, asked))
        yield


def send_target(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """SET_POSITION_TARGET_GLOBAL_INT: armed, in flight, GUIDED, and the vehicle's own target agrees."""
    yield from target_taken(flight, run, action)
    return SUCCEEDED


def go_to(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """As `send_target`, then within the tolerance of the target and slow."""
    yield from target_taken(flight, run, action)
    return (yield from arrive(flight, run, above_home(flight, action), action.tolerance))


def reposition(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_REPOSITION as COMMAND_INT: acknowledged, and the vehicle's own target agrees; param2 = 1 enters GUIDED."""
    vehicle, asked = flight.vehicle, flight.now
    yield from home_reported_for_limits(flight, run, action)
    into_guided = int(action.parameters[1]) & dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
    if not vehicle.aloft or not into_guided:
        check_guided_aloft(flight, "position targets")
    check_limits(flight, action)
    flight.expect_mode(vehicle.modes.guided)
    command, seen = flight.submit(run, flight.autopilot.reposition(flight, action), in_frame=True), vehicle.targets
    yield from acknowledged(flight, run, command, lambda: vehicle.targets > seen and target_is(flight, action))
    for attempt in range(TARGET_ATTEMPTS):
        if (yield from target_shown(flight, run, action, ask=attempt > 0)):
            return SUCCEEDED
    reason = f"{command.name} was acknowledged, but {own_target(flight, action)}"
    return Outcome("failed", flight.with_texts(reason, asked))


def reposition_and_arrive(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """As `reposition`, then within the tolerance of the target and, if the vehicle can stop, slow."""
    outcome = yield from reposition(flight, run, action)
    if outcome is not SUCCEEDED:
        return outcome
    return (yield from arrive(flight, run, above_home(flight, action), action.tolerance))


def orbit(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_ORBIT: the circle is within the limits, and the mode that flies it shows; another mode or target ends it."""
    modes = flight.vehicle.modes
    if modes.orbit is None:
        return Outcome("refused", f"{flight.autopilot.name} has no command by which a {modes.vehicle} flies a circle")
    yield from home_reported_for_limits(flight, run, action)
    check_guided_aloft(flight, "circles")
    check_limits(flight, action, around=abs(action.parameters[0]))
    yield from enter(flight, run, flight.autopilot.reposition(flight, action), modes.orbit)
    return SUCCEEDED


def land(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """NAV_LAND: landed and disarmed. Succeeds immediately on the ground and disarmed: LAND is no mode to arm in.

    A vehicle that does not land where it is flies the landing of its mission, if it does that on its way home.
    """
    modes = flight.vehicle.modes
    if parked(flight):
        return SUCCEEDED
    if not modes.lands:
        yield from _lands_by_mission(flight, run)
    landing = action if modes.lands and modes.lands_by_command else mode_action(modes, modes.land)
    yield from _enter_unless_stopped(flight, run, landing, modes.land)
    yield from down(flight, run)
    return SUCCEEDED


def _lands_by_mission(flight: ProcedureContext, run: ProcedureRun) -> Part:
    """Raises Ended unless the vehicle's way home ends by the landing of the mission that it stores."""
    switch = flight.autopilot.lands_by_mission
    cannot = f"a {flight.vehicle.modes.vehicle} of this kind has no mode that lands where it is"
    if switch is None or flight.vehicle.modes.ground:
        raise Ended("refused", cannot)
    with mission_protocol(flight, run):
        items = yield from download(flight, run)
    if not any(item.command == dialect.MAV_CMD_NAV_LAND for item in items):
        raise Ended("refused", f"{cannot}, and its mission has no landing: upload one with an item `land`")
    name, value = switch
    found = yield from read_parameter(flight, run, name)
    if found is None or found.value != value:
        got = "is not reported" if found is None else f"is {found.value:g}"
        raise Ended("refused", f"{cannot}, and it flies the landing of its mission with {name} {value:g}, which {got}")


def return_home(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """NAV_RETURN_TO_LAUNCH: landed and disarmed at home. Succeeds immediately if it is there."""
    vehicle, near = flight.vehicle, action.tolerance or 3.0
    if parked(flight):
        yield from home_reported(flight, run)
    if parked(flight):
        away = from_home(flight)
        if away is not None and away <= near:
            return SUCCEEDED
        return Outcome("refused", f"the vehicle is not armed and {metres(away)} from home")
    yield from _enter_unless_stopped(flight, run, action, vehicle.modes.rtl)
    yield from down(flight, run)
    away = from_home(flight)
    if away is not None and away <= near:
        return SUCCEEDED
    return Outcome("failed", f"the vehicle landed {metres(away)} from home")


def return_above(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """NAV_RETURN_TO_LAUNCH: within the tolerance of home over ground and, if the vehicle can stop, slow; still armed.

    For vehicles that do not land by themselves: a rover stops there, a plane circles.
    """
    vehicle, near = flight.vehicle, action.tolerance or 3.0
    if not vehicle.armed:
        return Outcome("refused", f"the vehicle is not armed and {metres(from_home(flight))} from home")
    asked = flight.now
    yield from enter(flight, run, action, vehicle.modes.rtl)
    while True:
        check_placed(flight, asked)
        away = from_home(flight)
        if away is not None:
            run.feedback = {"distance": round(away, 2), "speed": round(vehicle.speed, 2)}
            if away <= near and (vehicle.speed <= SLOW or not vehicle.modes.can_stop):
                return SUCCEEDED
        run.waits_for = f"home; it is {metres(away)} away"
        if not vehicle.armed:
            return Outcome("failed", flight.with_texts(f"the vehicle disarmed {metres(away)} from home", asked))
        yield


def secure(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """An order above the agents: the mode shows at two HEARTBEATs; on the ground the motors stop instead.

    `action.mode` is the mode. What follows the mode (the flight home, the landing) is not waited for. Judged
    here, when the vehicle is heard: it may have turned home while it could not be.
    """
    vehicle = flight.vehicle
    if not vehicle.armed:
        return Outcome("succeeded", "the vehicle is not armed")
    if vehicle.on_ground:
        stop = BoundAction(dialect.MAV_CMD_COMPONENT_ARM_DISARM, retry=action.retry)
        stopped = yield from _outcome_of(arm(flight, run, stop))
        if stopped.state == "succeeded" or not vehicle.armed:
            return stopped  # else it is not on the ground as it reported: it flies, and only the mode can stop it
    under_way = vehicle.modes.order_of(vehicle.mode)
    if run.yields and defers(vehicle.modes.order_of(action.mode), under_way):
        return Outcome("succeeded", f"{under_way} is under way: the vehicle is in {vehicle.mode_name}")
    otherwise = vehicle.modes.land_otherwise
    if action.mode != vehicle.modes.land or otherwise is None:
        return (yield from _enter_mode_of(flight, run, action))
    landing = yield from _outcome_of(_enter_mode_of(flight, run, action))
    if landing.state == "succeeded":
        return landing
    instead = yield from _enter_mode_of(flight, run, mode_action(vehicle.modes, otherwise))
    return replace(instead, reason=f"{instead.reason}; {landing.reason}")


def _enter_mode_of(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    if (yield from _enter_unless_stopped(flight, run, action, action.mode)):
        return Outcome("succeeded", f"the vehicle is in {flight.vehicle.mode_name}")
    return Outcome("succeeded", "the vehicle is not armed")


def _enter_unless_stopped(
    flight: ProcedureContext, run: ProcedureRun, action: BoundAction, mode: int
) -> Generator[None, None, bool]:
    """As `enter`. Returns whether the mode was entered; otherwise the motors stopped meanwhile, as after a landing."""
    was_armed = flight.vehicle.armed
    try:
        yield from enter(flight, run, action, mode)
    except Ended:
        if not was_armed or flight.vehicle.armed:
            raise
        return False
    return True


def hold_by_mode(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """A pause: the mode of `action` shows at two HEARTBEATs. Motors are left as they are, on the ground too."""
    vehicle = flight.vehicle
    if not vehicle.armed:
        return Outcome("succeeded", "the vehicle is not armed")
    return (yield from _enter_mode_of(flight, run, action))


def leave_hold(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """The end of a pause: a vehicle in the mode of the order `hold` enters that of `action`."""
    vehicle = flight.vehicle
    if vehicle.mode != vehicle.modes.hold:
        return Outcome("succeeded", f"the vehicle is in {vehicle.mode_name}")
    return (yield from _enter_mode_of(flight, run, action))


def stay(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """After a cancelled motion: the vehicle stays where it is, on the ground its motors stop.

    It is tried until the vehicle does it: nobody else waits for it. In flight GUIDED with the present place as the
    target comes first, the mode of the order `hold` after that, or immediately if the vehicle's position is not known.
    """
    vehicle, tries = flight.vehicle, 0
    lift_off = flight.now + flight.wait(*LIFT_OFF_WITHIN)
    while vehicle.armed:
        if not vehicle.connected:
            run.trouble = run.waits_for = "the vehicle is to stay where it is, and cannot be heard"
            yield
            continue
        if not vehicle.aloft:
            disarm = BoundAction(dialect.MAV_CMD_COMPONENT_ARM_DISARM)
            outcome = yield from _outcome_of(arm(flight, run, disarm))
            if outcome.state != "succeeded":
                while vehicle.armed and not vehicle.aloft and flight.now < lift_off:
                    yield
                if vehicle.aloft or not vehicle.armed:  # it left the ground anyway
                    continue
        elif vehicle.modes.stay_guided and vehicle.placed and not tries:
            outcome = yield from _outcome_of(_stay_here(flight, run, action))
        else:
            outcome = yield from _outcome_of(_enter_mode_of(flight, run, flight.autopilot.hold(vehicle.modes)))
        if outcome.state == "succeeded":
            run.trouble = ""
            return SUCCEEDED
        tries += 1
        run.trouble = f"the vehicle does not stay where it is: {outcome.reason}"
        log.warning("%s", run.trouble)
        yield from comes_true(flight, HOLD_EVERY, lambda: False)
    run.trouble = ""
    return SUCCEEDED


def _stay_here(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    vehicle = flight.vehicle
    if vehicle.mode != vehicle.modes.guided:
        yield from enter(flight, run, action, vehicle.modes.guided)
        return SUCCEEDED
    here = replace(action, target=vehicle.position, frame=dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, limited=False)
    return (yield from send_target(flight, run, here))


def _outcome_of(steps: Steps) -> Steps:
    """Return how a procedure ends, also if it ends in one of its parts."""
    try:
        return (yield from steps)
    except Ended as ended:
        return ended.outcome


SECURE = Procedure(secure, sets_mode=True)
"""Of the orders `hold`, `land` and `rtl`."""
HOLD = Procedure(hold_by_mode, sets_mode=True)
LEAVE_HOLD = Procedure(leave_hold, sets_mode=True)
STAY = Procedure(stay)
"""Of the bridge itself, when a motion is cancelled or leaves the mission's limits."""
