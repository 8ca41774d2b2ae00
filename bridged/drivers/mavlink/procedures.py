"""How each action is carried out and its success confirmed by the vehicle's state (design section 5).

An acknowledgement starts the wait for the state or ends it with a refusal; it never is the success. Each procedure is
a generator: the conversation resumes it on every message and tick, so it runs in virtual time and needs no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.commands import Command, Parameters
from bridged.drivers.mavlink.flight import SUCCEEDED, TEXT_WINDOW, Flight, Steps, Task
from bridged.drivers.mavlink.vehicle import OFF_GROUND, Place
from bridged.drivers.robot import Outcome
from schemas.manifest import Retry

MODE_ATTEMPTS = 4
"""A mode that is acknowledged but falls back is asked for again: ArduCopter does that while it boots."""
SETTLE = (4.0, 1.5)
"""Mission and wall seconds in which an acknowledged change must show in a HEARTBEAT."""
ASK_REASONS_EVERY = (5.0, 1.0)
"""Mission and wall seconds between requests for the reasons why the vehicle is not ready."""
LIFT_OFF_WITHIN = (15.0, 3.0)
"""Mission and wall seconds in which an acknowledged takeoff must leave the ground."""
TARGET_ATTEMPTS = 5
TARGET_WAIT = (1.5, 0.7)
"""Mission and wall seconds for the vehicle to report the target (message 87, asked for at 2 Hz) before it is resent."""
TARGET_NEAR = 1.0
"""Metres between the target sent and the one reported; rounding and frame conversion cost centimetres."""
SLOW = 0.5
"""m/s: arrived is near and not faster than this."""


@dataclass(frozen=True, slots=True)
class Call:
    """An action of the manifest with its arguments filled in."""

    number: int = 0
    parameters: Parameters = (0.0,) * 7
    retry: Retry = field(default_factory=Retry)
    target: Place | None = None
    frame: int = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    tolerance: float | None = None


Procedure = Callable[[Flight, Task, Call], Steps]


def change_mode(flight: Flight, task: Task, call: Call) -> Steps:
    """DO_SET_MODE: the mode shows, and still does at the next HEARTBEAT."""
    failure = yield from _enter(flight, task, call, int(call.parameters[1]))
    return failure or SUCCEEDED


def arm(flight: Flight, task: Task, call: Call) -> Steps:
    """COMPONENT_ARM_DISARM: waits until the vehicle is ready, then arms it; the state shows it at two HEARTBEATs."""
    wanted = call.parameters[0] == 1.0
    if wanted and not flight.vehicle.armed:
        yield from _ready(flight, task)

    def shown() -> bool:
        return flight.vehicle.armed == wanted

    asked = flight.now
    command = flight.submit(task, call.number, call.parameters, call.retry)
    refusal = yield from _acknowledged(flight, task, command, shown)
    if refusal is not None:
        return refusal
    task.waits_for = f"a HEARTBEAT that shows {'armed' if wanted else 'not armed'}"
    if (yield from _steady(flight, shown)):
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
    refusal = yield from _acknowledged(flight, task, command, rising)
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
    failure = yield from _target_taken(flight, task, call)
    return failure or SUCCEEDED


def go_to(flight: Flight, task: Task, call: Call) -> Steps:
    """As `send_target`, then within the tolerance of the target and slow."""
    failure = yield from _target_taken(flight, task, call)
    if failure is not None:
        return failure
    goal = _above_home(flight, call)
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
    if _parked(flight):
        return SUCCEEDED
    failure = yield from _enter(flight, task, call, flight.vehicle.modes.land)
    if failure is not None:
        return failure
    yield from _down(flight, task)
    return SUCCEEDED


def return_home(flight: Flight, task: Task, call: Call) -> Steps:
    """NAV_RETURN_TO_LAUNCH: landed and disarmed at home. At once if it stands there already."""
    vehicle, near = flight.vehicle, call.tolerance or 3.0
    if _parked(flight):
        away = _from_home(flight)
        if away is not None and away <= near:
            return SUCCEEDED
        return Outcome("refused", f"the vehicle is not armed and {_metres(away)} from home")
    failure = yield from _enter(flight, task, call, vehicle.modes.rtl)
    if failure is not None:
        return failure
    yield from _down(flight, task)
    away = _from_home(flight)
    if away is not None and away <= near:
        return SUCCEEDED
    return Outcome("failed", f"the vehicle landed {_metres(away)} from home")


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
    failure = yield from _enter(flight, task, call, int(call.parameters[1]))
    return failure or Outcome("succeeded", f"the vehicle is in {vehicle.mode_name}")


def stay(flight: Flight, task: Task, call: Call) -> Steps:
    """What cancelling a motion does: GUIDED, and where it is now as the target."""
    vehicle = flight.vehicle
    if not vehicle.aloft or vehicle.position is None:
        return SUCCEEDED
    if vehicle.mode != vehicle.modes.guided:
        failure = yield from _enter(flight, task, call, vehicle.modes.guided)
        return failure or SUCCEEDED
    here = replace(call, target=vehicle.position, frame=dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
    return (yield from send_target(flight, task, here))


def _enter(flight: Flight, task: Task, call: Call, mode: int) -> Generator[None, None, Outcome | None]:
    """Send a command that changes the mode until it sticks. Returns the failure, None if the mode is steady."""
    vehicle, before = flight.vehicle, flight.vehicle.mode
    asked, name = flight.now, flight.vehicle.modes.name(mode)

    def shown() -> bool:
        return vehicle.mode == mode

    command = None
    for _ in range(MODE_ATTEMPTS):
        flight.expect_mode(mode)
        command = flight.submit(task, call.number, call.parameters, call.retry)
        refusal = yield from _acknowledged(flight, task, command, shown)
        if refusal is not None:
            return refusal
        flight.expect_mode(mode)
        task.waits_for = f"two HEARTBEATs in {name}; the vehicle is in {vehicle.mode_name}"
        if (yield from _steady(flight, shown)):
            return None
        if vehicle.mode not in (before, mode):
            break
    said = f"{name} was acknowledged, but the vehicle is in {vehicle.mode_name}"
    return Outcome("failed", flight.with_texts(said, asked))


def _acknowledged(
    flight: Flight, task: Task, command: Command, effect: Callable[[], bool]
) -> Generator[None, None, Outcome | None]:
    """Wait until a command is accepted or its effect shows without that. Returns the refusal or the silence.

    A refusal of a repetition may mean that the first one worked, so the effect is waited for longer then.
    """
    asked = flight.now
    while not effect() and not command.accepted:
        if command.refused:
            patience = flight.now + flight.wait(*(TEXT_WINDOW if command.sent == 1 else SETTLE))
            while flight.now < patience and not effect():
                yield
            if effect():
                return None
            said = f"the vehicle refused {command.name} ({command.result_name})"
            return Outcome("refused", flight.with_texts(said, asked))
        if command.silent:
            said = f"no acknowledgement of {command.name} after sending it {command.sent} times, and no effect"
            return Outcome("failed", f"{said}; {flight.state_in_words()}")
        task.waits_for = f"the acknowledgement of {command.name}"
        yield
    command.may_repeat = lambda: False
    return None


def _steady(flight: Flight, shown: Callable[[], bool]) -> Generator[None, None, bool]:
    """Whether a state shows soon and still does at the next HEARTBEAT."""
    vehicle, patience = flight.vehicle, flight.now + flight.wait(*SETTLE)
    while not shown():
        if flight.now > patience:
            return False
        yield
    beats, patience = vehicle.heartbeats, flight.now + flight.wait(*SETTLE)
    while shown() and vehicle.heartbeats == beats and flight.now <= patience:
        yield
    return shown() and vehicle.heartbeats > beats


def _ready(flight: Flight, task: Task) -> Generator[None, None, None]:
    """Wait until the vehicle is ready to be armed, asking it for its reasons meanwhile."""
    ask_at = began = flight.now
    while missing := flight.vehicle.not_ready():
        said = flight.texts.since(max(began, flight.now - flight.wait(*ASK_REASONS_EVERY)))
        task.waits_for = "readiness: " + "; ".join([*missing, *([said] if said else [])])
        if flight.now >= ask_at and flight.vehicle.connected:
            ask_at = flight.now + flight.wait(*ASK_REASONS_EVERY)
            flight.submit(task, dialect.MAV_CMD_RUN_PREARM_CHECKS, (0.0,) * 7, Retry(times=0))
        yield


def _target_taken(flight: Flight, task: Task, call: Call) -> Generator[None, None, Outcome | None]:
    vehicle, asked = flight.vehicle, flight.now
    if call.target is None:
        raise ValueError(f"{task.name}: a call without a target")
    if vehicle.mode != vehicle.modes.guided:
        wanted = vehicle.modes.name(vehicle.modes.guided)
        return Outcome("refused", f"position targets are taken in {wanted} only; {flight.state_in_words()}")
    if not vehicle.aloft:
        return Outcome("refused", f"position targets are taken in flight only; {flight.state_in_words()}")
    home = flight.altitude_of_home()
    if home is None:
        return Outcome("refused", "the vehicle's altitude is not known yet")
    if broken := flight.outside_limits(_above_home(flight, call)):
        return Outcome("refused", broken)
    relative = call.frame == dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
    for _ in range(TARGET_ATTEMPTS):
        flight.send_target(call.target, call.frame)
        seen, patience = vehicle.targets, flight.now + flight.wait(*TARGET_WAIT)
        task.waits_for = "the vehicle to report the target as its own"
        while flight.now <= patience:
            yield
            if not vehicle.armed:
                return Outcome("failed", flight.with_texts("the vehicle disarmed", asked))
            if vehicle.targets > seen and vehicle.target is not None:
                home = flight.altitude_of_home() or home
                height = call.target.altitude + (home if relative else 0.0)
                aside = vehicle.target.distance(call.target)
                if aside <= TARGET_NEAR and abs(vehicle.target.altitude - height) <= TARGET_NEAR:
                    return None
    own = "it reports no target of its own"
    if vehicle.target is not None and vehicle.targets > seen:
        own = f"its own target is {vehicle.target.distance(call.target):.0f} m from there"
    said = f"the vehicle did not take the target in {TARGET_ATTEMPTS} tries (outside a fence, or out of reach?), {own}"
    return Outcome("refused", flight.with_texts(said, asked))


def _above_home(flight: Flight, call: Call) -> Place:
    """The target of a call with its altitude in metres above home."""
    target = call.target or Place(0.0, 0.0, 0.0)
    if call.frame == dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT:
        return target
    return Place(target.latitude, target.longitude, target.altitude - (flight.altitude_of_home() or 0.0))


def _down(flight: Flight, task: Task) -> Generator[None, None, None]:
    while not _parked(flight):
        position, away = flight.vehicle.position, _from_home(flight)
        if position is not None:
            task.feedback = {"altitude": round(position.altitude, 2)}
            if away is not None:
                task.feedback["distance"] = round(away, 2)
            task.waits_for = f"landing and disarming; it is at {position.altitude:.1f} m, {_metres(away)} from home"
        yield


def _parked(flight: Flight) -> bool:
    return flight.vehicle.connected and not flight.vehicle.armed and not flight.vehicle.aloft


def _from_home(flight: Flight) -> float | None:
    position, home = flight.vehicle.position, flight.vehicle.home
    return None if position is None or home is None else home.distance(position)


def _metres(distance: float | None) -> str:
    return "an unknown distance" if distance is None else f"{distance:.1f} m"


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
