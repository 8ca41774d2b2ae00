"""Commands that move no vehicle, or that are known by their acknowledgement alone: servo, gripper, fence, anything."""

from __future__ import annotations

from collections.abc import Generator

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.asking import Fits, Poll, asked_message
from bridged.drivers.mavlink.confirmation import acknowledged
from bridged.drivers.mavlink.flight import SUCCEEDED, Call, Flight, Steps, Task
from bridged.drivers.mavlink.parameters import read_parameter
from bridged.drivers.robot import Outcome

SERVOS = 16
"""Outputs that SERVO_OUTPUT_RAW tells of in one message."""
PWM_NEAR = 1
"""Microseconds."""
GRIPPER_PWM = {dialect.GRIPPER_ACTION_RELEASE: "GRIP_RELEASE", dialect.GRIPPER_ACTION_GRAB: "GRIP_GRAB"}
"""Parameters that tell the output of a gripper, by param2 of DO_GRIPPER."""
FENCE_ENABLE = "FENCE_ENABLE"
SHOWS_WITHIN = (5.0, 3.0)
"""Mission and wall seconds in which an output must show what was acknowledged."""


def acknowledge(flight: Flight, task: Task, call: Call) -> Steps:
    """Any command: the vehicle said ACCEPTED. The weakest of all: it says that it will try, not that it did."""
    command = flight.submit_call(task, call)
    refusal = yield from acknowledged(flight, task, command, lambda: False)
    return refusal or SUCCEEDED


def move_servo(flight: Flight, task: Task, call: Call) -> Steps:
    """DO_SET_SERVO: SERVO_OUTPUT_RAW shows the PWM on that output."""
    servo, wanted = int(call.parameters[0]), call.parameters[1]
    if not 1 <= servo <= SERVOS:
        return Outcome("refused", f"a servo is one of 1 to {SERVOS}, got {servo}")
    return (yield from _shown(flight, task, call, f"servo {servo} at {wanted:g}", lambda m: _near(m, servo, wanted)))


def grip(flight: Flight, task: Task, call: Call) -> Steps:
    """DO_GRIPPER: SERVO_OUTPUT_RAW shows on some output the PWM that the vehicle's parameter names for it."""
    parameter = GRIPPER_PWM.get(int(call.parameters[1]))
    if parameter is None:
        return Outcome("refused", f"a gripper releases (0) or grabs (1), got {call.parameters[1]:g}")
    found = yield from read_parameter(flight, task, parameter)
    if found is None:
        return Outcome("failed", f"the vehicle knows no parameter {parameter}; has it a gripper?")
    wanted = found[1]
    return (
        yield from _shown(
            flight, task, call, f"an output at {wanted:g} ({parameter})",
            lambda m: any(_near(m, servo, wanted) for servo in range(1, SERVOS + 1)),
        )
    )  # fmt: skip


def fence(flight: Flight, task: Task, call: Call) -> Steps:
    """DO_FENCE_ENABLE: the fence bit of SYS_STATUS agrees, or FENCE_ENABLE read back does."""
    wanted = call.parameters[0] >= 1.0
    command = flight.submit_call(task, call)
    refusal = yield from acknowledged(flight, task, command, lambda: False)
    if refusal is not None:
        return refusal
    bit = dialect.MAV_SYS_STATUS_GEOFENCE
    fresh = yield from asked_message(
        flight, task, "SYS_STATUS", (2.0, 1.5), lambda m: bool(m.onboard_control_sensors_enabled & bit) == wanted
    )
    if fresh is not None:
        return SUCCEEDED
    found = yield from read_parameter(flight, task, FENCE_ENABLE)
    if found is not None and (found[1] >= 1.0) == wanted:
        return SUCCEEDED
    said = "enabled" if wanted else "disabled"
    return Outcome("failed", f"{command.name} was acknowledged, but the fence is not {said}")


def _shown(flight: Flight, task: Task, call: Call, what: str, fits: Fits) -> Generator[None, None, Outcome]:
    """Send the command; the output proves it, also when the acknowledgement is lost."""
    poll, asked, seen = Poll(flight, task, "SERVO_OUTPUT_RAW"), flight.now, False

    def shown() -> bool:
        nonlocal seen
        poll()
        message = flight.message
        seen = seen or (message is not None and message.get_type() == "SERVO_OUTPUT_RAW" and fits(message))
        return seen

    command = flight.submit_call(task, call)
    refusal = yield from acknowledged(flight, task, command, shown)
    if refusal is not None:
        return refusal
    task.waits_for, until = f"SERVO_OUTPUT_RAW to show {what}", flight.now + flight.wait(*SHOWS_WITHIN)
    while flight.now <= until:
        if shown():
            return SUCCEEDED
        yield
    said = f"{command.name} was acknowledged, but SERVO_OUTPUT_RAW does not show {what}"
    return Outcome("failed", flight.with_texts(said, asked))


def _near(message: dialect.MAVLink_message, servo: int, pwm: float) -> bool:
    return bool(abs(getattr(message, f"servo{servo}_raw", 0) - pwm) <= PWM_NEAR)
