"""How each action is carried out and its success confirmed by the vehicle's state (design section 5).

An acknowledgement starts the wait for the state or ends it with a refusal; it never is the success. Each procedure is
a generator: the conversation resumes it on every message and tick, so it runs in virtual time and needs no clock.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.confirmation import (
    above_home,
    acknowledged,
    down,
    enter,
    from_home,
    metres,
    parked,
    ready,
    steady,
    target_taken,
)
from bridged.drivers.mavlink.flight import SUCCEEDED, Call, Flight, Steps, Task
from bridged.drivers.mavlink.vehicle import OFF_GROUND
from bridged.drivers.robot import Outcome

LIFT_OFF_WITHIN = (15.0, 3.0)
"""Mission and wall seconds in which an acknowledged takeoff must leave the ground."""
SLOW = 0.5
"""m/s: arrived is near and not faster than this."""

Procedure = Callable[[Flight, Task, Call], Steps]


def change_mode(flight: Flight, task: Task, call: Call) -> Steps:
    """DO_SET_MODE: the mode shows, and still does at the next HEARTBEAT."""
    failure = yield from enter(flight, task, call, int(call.parameters[1]))
    return failure or SUCCEEDED


def arm(flight: Flight, task: Task, call: Call) -> Steps:
    """COMPONENT_ARM_DISARM: waits until the vehicle is ready, then arms it; the state shows it at two HEARTBEATs."""
    wanted = call.parameters[0] == 1.0
    if wanted and not flight.vehicle.armed:
        yield from ready(flight, task)

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
    said = f"{command.name} was acknowledged, but the vehicle is {'not armed' if wanted else 'still armed'}"
    return Outcome("failed", flight.with_texts(said, asked))


def take_off(flight: Flight, task: Task, call: Call) -> Steps:
    """NAV_TAKEOFF: within the tolerance of the altitude above home."""
    vehicle, wanted, near = flight.vehicle, call.parameters[6], call.tolerance or 0.3
    if (limit := flight.limits.altitude) and wanted > limit:
        return Outcome("refused", f"altitude {wanted:g} m is above the mission's limit of {limit:g} m")
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
    seen = vehicle.positions
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
            said = f"{command.name} was acknowledged, but the vehicle did not leave the ground"
            return Outcome("failed", flight.with_texts(said, asked))
        yield


def send_target(flight: Flight, task: Task, call: Call) -> Steps:
    """SET_POSITION_TARGET_GLOBAL_INT: armed, in flight, GUIDED, and the vehicle's own target agrees."""
    failure = yield from target_taken(flight, task, call)
    return failure or SUCCEEDED


def go_to(flight: Flight, task: Task, call: Call) -> Steps:
    """As `send_target`, then within the tolerance of the target and slow."""
    failure = yield from target_taken(flight, task, call)
    if failure is not None:
        return failure
    goal = above_home(flight, call)
    near, asked = call.tolerance or 1.0, flight.now
    while True:
        vehicle = flight.vehicle
        if not vehicle.armed:
            return Outcome("failed", flight.with_texts("the vehicle disarmed on the way", asked))
        if vehicle.position is not None:
            distance, height = vehicle.position.distance(goal), goal.altitude - vehicle.position.altitude
            task.feedback = {
                "distance": round(distance, 2),
                "altitude": round(vehicle.position.altitude, 2),
                "speed": round(vehicle.speed, 2),
            }
            task.waits_for = f"arrival; {distance:.1f} m and {height:+.1f} m of height to go"
            if distance <= near and abs(height) <= near and vehicle.speed <= SLOW:
                return SUCCEEDED
        yield


def land(flight: Flight, task: Task, call: Call) -> Steps:
    """NAV_LAND: landed and disarmed. At once if it stands disarmed already: LAND is no mode to arm in."""
    if parked(flight):
        return SUCCEEDED
    failure = yield from enter(flight, task, call, flight.vehicle.modes.land)
    if failure is not None:
        return failure
    yield from down(flight, task)
    return SUCCEEDED


def return_home(flight: Flight, task: Task, call: Call) -> Steps:
    """NAV_RETURN_TO_LAUNCH: landed and disarmed at home. At once if it stands there already."""
    vehicle, near = flight.vehicle, call.tolerance or 3.0
    if parked(flight):
        away = from_home(flight)
        if away is not None and away <= near:
            return SUCCEEDED
        return Outcome("refused", f"the vehicle is not armed and {metres(away)} from home")
    failure = yield from enter(flight, task, call, vehicle.modes.rtl)
    if failure is not None:
        return failure
    yield from down(flight, task)
    away = from_home(flight)
    if away is not None and away <= near:
        return SUCCEEDED
    return Outcome("failed", f"the vehicle landed {metres(away)} from home")


def secure(flight: Flight, task: Task, call: Call) -> Steps:
    """An order from above the agents: the mode shows at two HEARTBEATs; on the ground the motors stop instead.

    `call.parameters[1]` is the mode. What follows the mode (the flight home, the landing) is not waited for.
    """
    vehicle = flight.vehicle
    if not vehicle.armed:
        return Outcome("succeeded", "the vehicle is not armed")
    if vehicle.landed_state == dialect.MAV_LANDED_STATE_ON_GROUND:
        stop = Call(dialect.MAV_CMD_COMPONENT_ARM_DISARM, (0.0,) * 7, call.retry)
        return (yield from arm(flight, task, stop))
    failure = yield from enter(flight, task, call, int(call.parameters[1]))
    return failure or Outcome("succeeded", f"the vehicle is in {vehicle.mode_name}")


def stay(flight: Flight, task: Task, call: Call) -> Steps:
    """What cancelling a motion does: GUIDED, and where it is now as the target."""
    vehicle = flight.vehicle
    if not vehicle.aloft or vehicle.position is None:
        return SUCCEEDED
    if vehicle.mode != vehicle.modes.guided:
        failure = yield from enter(flight, task, call, vehicle.modes.guided)
        return failure or SUCCEEDED
    here = replace(call, target=vehicle.position, frame=dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
    return (yield from send_target(flight, task, here))


PROCEDURES: dict[str, Procedure] = {
    "mode": change_mode,
    "armed": arm,
    "altitude": take_off,
    "target": send_target,
    "arrival": go_to,
    "landed": land,
    "home": return_home,
}
"""By the manifest's `confirm`."""
