"""How each action is carried out and its success confirmed by the vehicle's state (design section 5).

An acknowledgement starts the wait for the state or ends it with a refusal; it never is the success. Each procedure is
a generator: the conversation resumes it on every message and tick, so it runs in virtual time and needs no clock.
"""

from __future__ import annotations

import logging
from collections.abc import Generator
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, defers
from bridged.drivers.mavlink.actions.confirmation import (
    SLOW,
    TARGET_ATTEMPTS,
    above_home,
    acknowledged,
    arrive,
    down,
    enter,
    from_home,
    guided_aloft,
    metres,
    own_target,
    parked,
    ready,
    steady,
    target_is,
    target_shown,
    target_taken,
    within_limits,
)
from bridged.drivers.mavlink.actions.context import SUCCEEDED, Call, ProcedureContext, Steps, Task
from bridged.drivers.mavlink.actions.parameters import write_parameter
from bridged.drivers.mavlink.vehicle.state import OFF_GROUND
from schemas.manifest.loader import Retry

HOLD_EVERY = (2.0, 1.0)
"""Mission and wall seconds between two attempts to make a vehicle stay where it is."""
LIFT_OFF_WITHIN = (15.0, 3.0)
"""Mission and wall seconds in which an acknowledged takeoff must leave the ground."""

log = logging.getLogger("mavlink")


def change_mode(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """DO_SET_MODE: the mode shows, and still does at the next HEARTBEAT."""
    failure = yield from enter(flight, task, call, int(call.parameters[1]))
    return failure or SUCCEEDED


def arm(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """COMPONENT_ARM_DISARM: waits until the vehicle is ready, then arms it; the state shows it at two HEARTBEATs."""
    wanted = call.parameters[0] == 1.0
    if wanted and (other := flight.vehicle.contradiction):
        return Outcome("refused", other)
    if wanted and not flight.vehicle.armed:
        unready = yield from ready(flight, task)
        if unready is not None:
            return unready

    def shown() -> bool:
        return flight.vehicle.armed == wanted

    asked = flight.now
    command = flight.submit(task, call.number, call.parameters, call.retry)
    refusal = yield from acknowledged(flight, task, command, shown)
    if refusal is not None:
        return refusal
    task.waits_for = f"a HEARTBEAT that shows {'armed' if wanted else 'not armed'}"
    if (yield from steady(flight, shown)):
        return SUCCEEDED
    state = "not armed" if wanted else "still armed"
    if shown():
        said = f"one HEARTBEAT showed {'armed' if wanted else 'not armed'}, and no second one came: it may be so"
    else:
        said = f"{command.name} was acknowledged, but the vehicle is {state}"
    return Outcome("failed", flight.with_texts(said, asked))


def take_off(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """NAV_TAKEOFF: within the tolerance of the altitude above home."""
    vehicle, wanted = flight.vehicle, call.parameters[6]
    if broken := flight.too_high(wanted):
        return Outcome("refused", broken, "limits")
    if flight.goes_on(call) and vehicle.aloft:
        return (yield from _climb_on(flight, task, call))
    aloft_before = vehicle.aloft
    ground = vehicle.position.altitude if vehicle.position is not None else 0.0

    def rising() -> bool:
        climbed = vehicle.position is not None and vehicle.armed and vehicle.position.altitude > ground + OFF_GROUND
        return (vehicle.aloft or climbed) and not aloft_before

    asked = flight.now
    command = flight.submit(task, call.number, call.parameters, call.retry, may_repeat=lambda: not rising())
    refusal = yield from acknowledged(flight, task, command, rising)
    if refusal is not None:
        return refusal
    return (yield from _climb(flight, task, wanted, call.tolerance or 0.3, command.name, asked))


def take_off_by_mode(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """`takeoff_by_mode`: TKOFF_ALT is set, TAKEOFF entered, and the altitude above home reached (planes)."""
    vehicle, wanted = flight.vehicle, call.arguments["altitude"]
    mode = vehicle.modes.takeoff
    if mode is None or not isinstance(wanted, int | float):
        return Outcome("refused", f"a vehicle of this kind has no mode to take off by: {vehicle.modes.vehicle}")
    if broken := flight.too_high(float(wanted)):
        return Outcome("refused", broken, "limits")
    if not vehicle.armed or (vehicle.aloft and not flight.goes_on(call)):
        return Outcome("refused", f"a takeoff begins armed on the ground; {flight.state_in_words()}")
    failure = yield from write_parameter(flight, task, "TKOFF_ALT", float(wanted))
    if failure is not None:
        return failure
    asked = flight.now
    failure = yield from enter(flight, task, mode_call(mode), mode)
    if failure is not None:
        return failure
    return (yield from _climb(flight, task, float(wanted), call.tolerance or 5.0, vehicle.modes.name(mode), asked))


def _climb_on(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """Continue a takeoff that was paused in the air, where NAV_TAKEOFF is refused: by a target above."""
    vehicle, wanted, asked = flight.vehicle, call.parameters[6], flight.now
    if vehicle.position is None:
        return Outcome("refused", "the vehicle has not reported where it is")
    above = replace(vehicle.position, altitude=wanted)
    target = replace(call, target=above, frame=dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, limited=False)
    failure = yield from target_taken(flight, task, target)
    return failure or (yield from _climb(flight, task, wanted, call.tolerance or 0.3, "the target above", asked))


def _climb(flight: ProcedureContext, task: Task, wanted: float, near: float, name: str, asked: float) -> Steps:
    """Wait until the altitude is reached; off the ground before long."""
    vehicle, seen = flight.vehicle, flight.vehicle.positions
    patience = flight.now + flight.wait(*LIFT_OFF_WITHIN)
    while True:
        if not vehicle.armed:
            return Outcome("failed", flight.with_texts("the vehicle disarmed before it was up", asked))
        if vehicle.position is not None and vehicle.positions > seen:
            climbed = vehicle.position.altitude
            task.feedback = {"altitude": round(climbed, 2), "to_go": round(wanted - climbed, 2)}
            task.waits_for = f"altitude {wanted:g} m; it is at {climbed:.1f} m"
            if abs(climbed - wanted) <= near:
                return SUCCEEDED
        elif vehicle.positions == seen:
            task.waits_for = "a position from the vehicle"
        if not vehicle.aloft and flight.now > patience:
            said = f"{name} was acknowledged, but the vehicle did not leave the ground"
            return Outcome("failed", flight.with_texts(said, asked))
        yield


def send_target(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """SET_POSITION_TARGET_GLOBAL_INT: armed, in flight, GUIDED, and the vehicle's own target agrees."""
    failure = yield from target_taken(flight, task, call)
    return failure or SUCCEEDED


def go_to(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """As `send_target`, then within the tolerance of the target and slow."""
    failure = yield from target_taken(flight, task, call)
    return failure or (yield from arrive(flight, task, above_home(flight, call), call.tolerance))


def reposition(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """DO_REPOSITION as COMMAND_INT: acknowledged, and the vehicle's own target agrees; param2 = 1 enters GUIDED."""
    vehicle, asked = flight.vehicle, flight.now
    into_guided = int(call.parameters[1]) & dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
    if not vehicle.aloft or not into_guided:
        refusal = guided_aloft(flight, "position targets")
        if refusal is not None:
            return refusal
    if (refusal := within_limits(flight, call)) is not None:
        return refusal
    flight.expect_mode(vehicle.modes.guided)
    command, seen = flight.submit_call(task, call), vehicle.targets
    refusal = yield from acknowledged(flight, task, command, lambda: vehicle.targets > seen and target_is(flight, call))
    if refusal is not None:
        return refusal
    for _ in range(TARGET_ATTEMPTS):
        task.waits_for = "the vehicle to report the target as its own"
        if (yield from target_shown(flight, call)):
            return SUCCEEDED
    said = f"{command.name} was acknowledged, but {own_target(flight, call)}"
    return Outcome("failed", flight.with_texts(said, asked))


def reposition_and_arrive(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """As `reposition`, then within the tolerance of the target and, if the vehicle can stand, slow."""
    outcome = yield from reposition(flight, task, call)
    if outcome is not SUCCEEDED:
        return outcome
    return (yield from arrive(flight, task, above_home(flight, call), call.tolerance))


def land(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """NAV_LAND: landed and disarmed. Succeeds immediately on the ground and disarmed: LAND is no mode to arm in."""
    modes = flight.vehicle.modes
    if parked(flight):
        return SUCCEEDED
    if not modes.lands:
        said = "" if modes.ground else "; end a mission with an item `land`"
        return Outcome("refused", f"an {modes.vehicle} of this kind has no mode that lands where it is{said}")
    failure = yield from enter(flight, task, call, modes.land)
    if failure is None:
        failure = yield from down(flight, task)
    return failure or SUCCEEDED


def return_home(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """NAV_RETURN_TO_LAUNCH: landed and disarmed at home. Succeeds immediately if it is there."""
    vehicle, near = flight.vehicle, call.tolerance or 3.0
    if parked(flight):
        away = from_home(flight)
        if away is not None and away <= near:
            return SUCCEEDED
        return Outcome("refused", f"the vehicle is not armed and {metres(away)} from home")
    failure = yield from enter(flight, task, call, vehicle.modes.rtl)
    if failure is None:
        failure = yield from down(flight, task)
    if failure is not None:
        return failure
    away = from_home(flight)
    if away is not None and away <= near:
        return SUCCEEDED
    return Outcome("failed", f"the vehicle landed {metres(away)} from home")


def return_above(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """NAV_RETURN_TO_LAUNCH: within the tolerance of home over ground and, if the vehicle can stand, slow; still armed.

    For vehicles that do not land by themselves: a rover stops there, a plane circles.
    """
    vehicle, near = flight.vehicle, call.tolerance or 3.0
    if not vehicle.armed:
        return Outcome("refused", f"the vehicle is not armed and {metres(from_home(flight))} from home")
    asked = flight.now
    failure = yield from enter(flight, task, call, vehicle.modes.rtl)
    if failure is not None:
        return failure
    while True:
        away = from_home(flight)
        if away is not None:
            task.feedback = {"distance": round(away, 2), "speed": round(vehicle.speed, 2)}
            if away <= near and (vehicle.speed <= SLOW or not vehicle.modes.stands):
                return SUCCEEDED
        task.waits_for = f"home; it is {metres(away)} away"
        if not vehicle.armed:
            return Outcome("failed", flight.with_texts(f"the vehicle disarmed {metres(away)} from home", asked))
        yield


def mode_call(mode: int) -> Call:
    """DO_SET_MODE to a mode of the vehicle."""
    parameters = (float(dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(mode), 0.0, 0.0, 0.0, 0.0, 0.0)
    return Call(dialect.MAV_CMD_DO_SET_MODE, parameters, Retry())


def secure(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """An order above the agents: the mode shows at two HEARTBEATs; on the ground the motors stop instead.

    `call.parameters[1]` is the mode. What follows the mode (the flight home, the landing) is not waited for. Judged
    here, when the vehicle is heard: it may have turned home while it could not be.
    """
    vehicle = flight.vehicle
    if not vehicle.armed:
        return Outcome("succeeded", "the vehicle is not armed")
    if vehicle.on_ground:
        stop = Call(dialect.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,) * 7, call.retry)
        stopped = yield from arm(flight, task, stop)
        if stopped.state == "succeeded" or not vehicle.armed:
            return stopped  # else it is not on the ground as it said: it flies, and the mode is what is left
    mode, under_way = int(call.parameters[1]), vehicle.modes.order_of(vehicle.mode)
    if task.yields and defers(vehicle.modes.order_of(mode), under_way):
        return Outcome("succeeded", f"{under_way} is under way: the vehicle is in {vehicle.mode_name}")
    return (yield from _enter_mode_of(flight, task, call))


def _enter_mode_of(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    failure = yield from enter(flight, task, call, int(call.parameters[1]))
    return failure or Outcome("succeeded", f"the vehicle is in {flight.vehicle.mode_name}")


def hold_by_mode(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """A pause: the mode of `call` shows at two HEARTBEATs. Motors are left as they are, on the ground too."""
    vehicle = flight.vehicle
    if not vehicle.armed:
        return Outcome("succeeded", "the vehicle is not armed")
    return (yield from _enter_mode_of(flight, task, call))


def leave_hold(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """The end of a pause: a vehicle in the mode of the order `hold` enters that of `call`."""
    vehicle = flight.vehicle
    if vehicle.mode != vehicle.modes.hold:
        return Outcome("succeeded", f"the vehicle is in {vehicle.mode_name}")
    return (yield from _enter_mode_of(flight, task, call))


def stay(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    """After a cancelled motion: the vehicle stays where it is, on the ground its motors stop.

    It is tried until the vehicle does it: nobody else waits for it. In flight GUIDED with the present place as the
    target comes first, the mode of the order `hold` after that, or at once if nothing tells where the vehicle is.
    """
    vehicle, tries = flight.vehicle, 0
    lift_off = flight.now + flight.wait(*LIFT_OFF_WITHIN)
    while vehicle.armed:
        if not vehicle.connected:
            task.trouble = task.waits_for = "the vehicle is to stay where it is, and cannot be heard"
            yield
            continue
        outcome: Outcome | None
        if not vehicle.aloft:
            outcome = yield from _stop_motors(flight, task, lift_off)
        elif vehicle.modes.stay_guided and vehicle.placed and not tries:
            outcome = yield from _stay_here(flight, task, call)
        else:
            hold = vehicle.modes.hold
            failure = yield from enter(flight, task, mode_call(hold), hold)
            outcome = failure or SUCCEEDED
        if outcome is None:
            continue
        if outcome.state == "succeeded":
            task.trouble = ""
            return outcome
        tries += 1
        task.trouble = f"the vehicle does not stay where it is: {outcome.reason}"
        log.warning("%s", task.trouble)
        again = flight.now + flight.wait(*HOLD_EVERY)
        while flight.now < again:
            yield
    task.trouble = ""
    return SUCCEEDED


def _stay_here(flight: ProcedureContext, task: Task, call: Call) -> Steps:
    vehicle = flight.vehicle
    if vehicle.mode != vehicle.modes.guided:
        failure = yield from enter(flight, task, call, vehicle.modes.guided)
        return failure or SUCCEEDED
    here = replace(call, target=vehicle.position, frame=dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, limited=False)
    return (yield from send_target(flight, task, here))


def _stop_motors(flight: ProcedureContext, task: Task, lift_off: float) -> Generator[None, None, Outcome | None]:
    """Disarm a vehicle that has not left the ground; None if it leaves the ground anyway."""
    vehicle = flight.vehicle
    stopped = yield from arm(flight, task, Call(dialect.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,) * 7, Retry()))
    if stopped.state == "succeeded":
        return stopped
    while vehicle.armed and not vehicle.aloft and flight.now < lift_off:
        yield
    return None if vehicle.aloft or not vehicle.armed else stopped
