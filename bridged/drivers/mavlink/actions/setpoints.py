"""Setpoints without acknowledgement: places in metres, velocities in m/s, and the channels of a remote control.

The vehicle's own report is the proof: POSITION_TARGET_LOCAL_NED shows the target that it flies, RC_CHANNELS what it
takes for the sticks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.arrival import arrive
from bridged.drivers.mavlink.actions.confirmation import (
    TARGET_ATTEMPTS,
    TARGET_NEAR,
    TARGET_WAIT,
    Fits,
    asked_message,
    check_guided_aloft,
    target_taken,
)
from bridged.drivers.mavlink.actions.context import (
    POSITION_IGNORED,
    SUCCEEDED,
    VELOCITY_IGNORED,
    BoundAction,
    Ended,
    LocalTarget,
    Part,
    ProcedureContext,
    ProcedureRun,
    Steps,
    Triple,
)

SPEED_NEAR = 0.15
"""m/s between the velocity sent and the one reported."""
RC_ATTEMPTS = 4
RC_NEAR = 3
"""Microseconds between a channel sent and the one reported."""
RC_IGNORE, RC_RELEASE = 65535, 0
"""Values of RC_CHANNELS_OVERRIDE: the channel stays as it is; the remote control has it again."""
RC_IGNORE_HIGH, RC_RELEASE_HIGH = 0, 65534
"""The same for the channels from 9 on."""
RC_CHANNELS = 18
LOCAL, BODY = dialect.MAV_FRAME_LOCAL_NED, dialect.MAV_FRAME_BODY_OFFSET_NED


def send_local_place(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """SET_POSITION_TARGET_LOCAL_NED with a place: the vehicle's own target agrees."""
    yield from _place_taken(flight, run, action)
    return SUCCEEDED


def go_to_local(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """As `send_local_place`, then within the tolerance of the target and slow."""
    yield from _place_taken(flight, run, action)
    vehicle, seen = flight.vehicle, flight.vehicle.targets
    shown = yield from asked_message(flight, run, "POSITION_TARGET_GLOBAL_INT", (5.0, 3.0))
    if shown is None or vehicle.target is None or vehicle.targets == seen:
        return Outcome("failed", "the vehicle does not report where on earth its target is")
    goal = replace(vehicle.target, altitude=vehicle.target.altitude - (flight.altitude_of_home() or 0.0))
    return (yield from arrive(flight, run, goal, action.tolerance))


def send_velocity(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """SET_POSITION_TARGET_LOCAL_NED with a velocity: the vehicle's own target agrees.

    The vehicle stops 3 s after the last one; that is the end of the motion, not of the action.
    """
    target = _local(run, action)
    check_guided_aloft(flight, "velocities")
    if target.velocity is None:
        raise ValueError(f"{run.name}: a velocity without one")
    velocity = _over_ground(flight, target)
    if velocity is None:
        return Outcome("refused", "the vehicle's heading is not known yet")
    if action.limited and (broken := flight.leads_outside(velocity)):
        return Outcome("refused", broken, "limits")

    def fits(message: dialect.MAVLink_message) -> bool:
        if message.type_mask & VELOCITY_IGNORED:
            return False
        reported = (message.vx, message.vy, message.vz)
        if target.frame == LOCAL:
            return math.dist(reported, velocity) <= SPEED_NEAR
        level = math.hypot(*reported[:2]) - math.hypot(*velocity[:2])  # the heading moves on meanwhile
        return abs(level) <= SPEED_NEAR and abs(reported[2] - velocity[2]) <= SPEED_NEAR

    send = yield from flight.autopilot.begin_velocity(flight, run, target)
    if (yield from _sent_until_shown(flight, run, send, fits)):
        return SUCCEEDED
    reason = f"the vehicle did not take the velocity in {TARGET_ATTEMPTS} tries"
    return Outcome("refused", f"{reason}; {flight.state_text()}")


def override_channels(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """RC_CHANNELS_OVERRIDE: RC_CHANNELS shows the values; a released channel cannot be confirmed."""

    def fits(message: dialect.MAVLink_message) -> bool:
        return all(
            abs(getattr(message, f"chan{index}_raw") - value) <= RC_NEAR
            for index, value in enumerate(action.channels, 1)
            if value not in (RC_IGNORE, RC_RELEASE) and not (index > 8 and value == RC_RELEASE_HIGH)
        )

    for _ in range(RC_ATTEMPTS):
        _send_channels(flight, action)
        run.waits_for = "RC_CHANNELS to show the channels that were sent"
        if (yield from asked_message(flight, run, "RC_CHANNELS", TARGET_WAIT, fits)) is not None:
            return SUCCEEDED
    reason = "RC_CHANNELS does not show them: ArduPilot takes overrides from its ground station only (MAV_GCS_SYSID)"
    return Outcome("failed", flight.with_texts(reason, flight.now))


def send_channels(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """RC_CHANNELS_OVERRIDE, sent once to a vehicle that is heard: nothing shows that it was taken."""
    _send_channels(flight, action)
    return SUCCEEDED
    yield  # a procedure is a generator, also one that waits for nothing


def _place_taken(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Part:
    """Send the place until the vehicle reports it as its own."""
    target = _local(run, action)
    check_guided_aloft(flight, "position targets")
    here = yield from asked_message(flight, run, "LOCAL_POSITION_NED", (5.0, 3.0))
    position = flight.vehicle.position if flight.vehicle.placed else None
    if here is None or position is None or target.position is None:
        raise Ended("refused", "the vehicle does not report its position on earth and its local one")
    goal = _from_origin(flight, target, here)
    if goal is None:
        raise Ended("refused", "the vehicle's heading is not known yet")
    north, east, down = (there - now for there, now in zip(goal, (here.x, here.y, here.z), strict=True))
    there = position.moved(north, east, -down)
    if action.limited and (broken := flight.outside_limits(there)):
        raise Ended("refused", broken, "limits")
    if not flight.autopilot.local_places:
        frame = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        yield from target_taken(flight, run, replace(action, target=there, frame=frame, yaw=target.yaw))
        return

    def fits(message: dialect.MAVLink_message) -> bool:
        shown = not message.type_mask & POSITION_IGNORED
        return shown and math.dist((message.x, message.y, message.z), goal) <= TARGET_NEAR

    absolute = LocalTarget(LOCAL, goal, yaw=target.yaw, yaw_rate=target.yaw_rate)  # a repetition must not add up
    if not (yield from _sent_until_shown(flight, run, lambda: flight.send_local(absolute), fits)):
        reason = f"the vehicle did not take the target in {TARGET_ATTEMPTS} tries (outside a fence, or out of reach?)"
        raise Ended("refused", f"{reason}; {flight.state_text()}")


def _sent_until_shown(
    flight: ProcedureContext, run: ProcedureRun, send: Callable[[], None], fits: Fits
) -> Generator[None, None, bool]:
    for _ in range(TARGET_ATTEMPTS):
        send()
        run.waits_for = "the vehicle to report the target as its own"
        if (yield from asked_message(flight, run, "POSITION_TARGET_LOCAL_NED", TARGET_WAIT, fits)) is not None:
            return True
    return False


def _from_origin(flight: ProcedureContext, target: LocalTarget, here: dialect.MAVLink_message) -> Triple | None:
    """Return a place in metres north, east, down of the origin; one in the body frame is relative to the vehicle."""
    north, east, down = target.position or (0.0, 0.0, 0.0)
    if target.frame == LOCAL:
        return north, east, down
    turned = _turned(flight.vehicle.heading, north, east)
    return None if turned is None else (here.x + turned[0], here.y + turned[1], here.z + down)


def _over_ground(flight: ProcedureContext, target: LocalTarget) -> Triple | None:
    one, two, down = target.velocity or (0.0, 0.0, 0.0)
    if target.frame == LOCAL or not (one or two):
        return one, two, down
    turned = _turned(flight.vehicle.heading, one, two)
    return None if turned is None else (*turned, down)


def _turned(heading: float | None, forward: float, right: float) -> tuple[float, float] | None:
    if heading is None:
        return None
    cos, sin = math.cos(heading), math.sin(heading)
    return forward * cos - right * sin, forward * sin + right * cos


def _send_channels(flight: ProcedureContext, action: BoundAction) -> None:
    rest = [RC_IGNORE if index < 8 else RC_IGNORE_HIGH for index in range(len(action.channels), RC_CHANNELS)]
    flight.send(dialect.MAVLink_rc_channels_override_message(*flight.addressee, *action.channels, *rest))


def _local(run: ProcedureRun, action: BoundAction) -> LocalTarget:
    if action.local is None:
        raise ValueError(f"{run.name}: an action without a target")
    return action.local
