"""Commands that move no vehicle, or are confirmed by their acknowledgement alone: servo, gripper, fence, others."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.confirmation import Fits, Poll, acknowledged
from bridged.drivers.mavlink.actions.context import SUCCEEDED, BoundAction, Ended, ProcedureContext, ProcedureRun, Steps
from bridged.drivers.mavlink.actions.mission_actions import MOVES_HOME
from bridged.drivers.mavlink.actions.mission_execution import may_fly
from bridged.drivers.mavlink.actions.parameters import guard, read_parameter, read_parameters, write_parameter

SERVOS = 16
"""Outputs in one SERVO_OUTPUT_RAW message."""
PWM_NEAR = 1
"""Microseconds."""
GRIPPER_PWM = {dialect.GRIPPER_ACTION_RELEASE: "GRIP_RELEASE", dialect.GRIPPER_ACTION_GRAB: "GRIP_GRAB"}
"""Parameters of a gripper's PWM, by param2 of DO_GRIPPER."""
FUNCTIONS = tuple(f"SERVO{output}_FUNCTION" for output in range(1, SERVOS + 1))
GRIPPER = 28.0
"""SERVOn_FUNCTION of an output that moves a gripper."""
FENCE_ENABLE = "FENCE_ENABLE"
SHOWS_WITHIN, FENCE_SHOWS_WITHIN = (5.0, 3.0), (2.0, 1.5)
"""Mission and wall seconds in which an output, or the fence, must show what was acknowledged."""


def acknowledge(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """Any command: the vehicle acknowledged it with ACCEPTED. The weakest confirmation: it will try.

    MISSION_START needs a mission that may be flown; under limits home, from where they are measured, is not moved.
    """
    if action.number == dialect.MAV_CMD_DO_SET_HOME and flight.limited:
        return Outcome("refused", MOVES_HOME)
    if action.number == dialect.MAV_CMD_MISSION_START:
        yield from may_fly(flight, run)
        flight.expect_mode(flight.vehicle.modes.auto)
    command = flight.submit(run, action, in_frame=True)
    yield from acknowledged(flight, run, command, lambda: False)
    return SUCCEEDED


def move_servo(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_SET_SERVO: SERVO_OUTPUT_RAW shows the PWM on that output."""
    servo, wanted = int(action.parameters[0]), action.parameters[1]
    if not 1 <= servo <= SERVOS:
        return Outcome("refused", f"a servo is one of 1 to {SERVOS}, got {servo}")
    return (yield from _shown(flight, run, action, f"servo {servo} at {wanted:g}", lambda m: _near(m, servo, wanted)))


def grip(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_GRIPPER: SERVO_OUTPUT_RAW shows on the gripper's own outputs the PWM that the vehicle's parameter names."""
    parameter = GRIPPER_PWM.get(int(action.parameters[1]))
    if parameter is None:
        return Outcome("refused", f"a gripper releases (0) or grabs (1), got {action.parameters[1]:g}")
    if not flight.autopilot.outputs_show:
        return (yield from acknowledge(flight, run, action))
    found = yield from read_parameter(flight, run, parameter)
    if found is None:
        return Outcome("failed", f"the vehicle knows no parameter {parameter}; has it a gripper?")
    functions = yield from read_parameters(flight, run, FUNCTIONS)
    outputs = [output for output, name in enumerate(FUNCTIONS, 1) if functions.get(name) == GRIPPER]
    if not outputs:
        return Outcome(
            "failed", f"none of the {len(functions)} outputs that were reported is a gripper (SERVOn_FUNCTION = 28)"
        )
    wanted, named = found.value, " and ".join(map(str, outputs))
    return (
        yield from _shown(
            flight, run, action, f"output {named} at {wanted:g} ({parameter})",
            lambda m: all(_near(m, output, wanted) for output in outputs),
        )
    )  # fmt: skip


def fence(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_FENCE_ENABLE: the fence bit of SYS_STATUS agrees, or FENCE_ENABLE read back does, acknowledged or not."""
    wanted = action.parameters[0] >= 1.0
    if not wanted and (guarded := guard(flight, FENCE_ENABLE, 0.0)):
        return Outcome("refused", guarded)
    if flight.autopilot.fence_switch is not None:
        return (yield from _fence_by_parameter(flight, run, *flight.autopilot.fence_switch, wanted=wanted))
    bit = dialect.MAV_SYS_STATUS_GEOFENCE
    agrees = _Seen(flight, run, "SYS_STATUS", lambda m: bool(m.onboard_control_sensors_enabled & bit) == wanted)
    command = flight.submit(run, action, in_frame=True)
    refusal: Ended | None = None
    try:
        yield from acknowledged(flight, run, command, agrees)
    except Ended as ended:
        if command.refused:
            raise
        refusal = ended
    run.waits_for, until = "SYS_STATUS to show the fence", flight.now + flight.wait(*FENCE_SHOWS_WITHIN)
    while refusal is None and flight.now <= until:
        if agrees():
            return SUCCEEDED
        yield
    found = yield from read_parameter(flight, run, FENCE_ENABLE)
    if found is not None and (found.value >= 1.0) == wanted:
        return SUCCEEDED
    if refusal is not None:
        raise refusal
    state = "enabled" if wanted else "disabled"
    return Outcome("failed", f"{command.name} was acknowledged, but the fence is not {state}")


def _fence_by_parameter(flight: ProcedureContext, run: ProcedureRun, name: str, on: float, *, wanted: bool) -> Steps:
    """Switch the fence by a parameter: on as it is if it is, off at 0."""
    found = yield from read_parameter(flight, run, name)
    if found is None:
        return Outcome("failed", f"the vehicle knows no parameter {name}")
    if (found.value != 0.0) != wanted:
        yield from write_parameter(flight, run, name, on if wanted else 0.0)
    return SUCCEEDED


def _shown(flight: ProcedureContext, run: ProcedureRun, action: BoundAction, what: str, fits: Fits) -> Steps:
    """Send the command; the output confirms it, also if the acknowledgement is lost."""
    asked, shown = flight.now, _Seen(flight, run, "SERVO_OUTPUT_RAW", fits)
    command = flight.submit(run, action, in_frame=True)
    yield from acknowledged(flight, run, command, shown)
    run.waits_for, until = f"SERVO_OUTPUT_RAW to show {what}", flight.now + flight.wait(*SHOWS_WITHIN)
    while flight.now <= until:
        if shown():
            return SUCCEEDED
        yield
    reason = f"{command.name} was acknowledged, but SERVO_OUTPUT_RAW does not show {what}"
    return Outcome("failed", flight.with_texts(reason, asked))


class _Seen:
    """Requests a message repeatedly, and knows whether a matching one has arrived."""

    def __init__(self, flight: ProcedureContext, run: ProcedureRun, name: str, fits: Fits) -> None:
        self._flight, self._name, self._fits = flight, name, fits
        self._poll = Poll(flight, run, name)
        self._seen = False

    def __call__(self) -> bool:
        self._poll()
        message = self._flight.message
        self._seen = self._seen or (message is not None and message.get_type() == self._name and self._fits(message))
        return self._seen


def _near(message: dialect.MAVLink_message, servo: int, pwm: float) -> bool:
    return bool(abs(getattr(message, f"servo{servo}_raw", 0) - pwm) <= PWM_NEAR)
