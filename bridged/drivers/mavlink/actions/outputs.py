"""Commands that move no vehicle: servo, relay, winch, gripper, fence, and what only an acknowledgement confirms."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome
from bridged.drivers.mavlink.actions.confirmation import Fits, Poll, acknowledged, asked_message, comes_true
from bridged.drivers.mavlink.actions.context import SUCCEEDED, BoundAction, Ended, ProcedureContext, ProcedureRun, Steps
from bridged.drivers.mavlink.actions.mission_actions import MOVES_HOME
from bridged.drivers.mavlink.actions.mission_execution import may_fly
from bridged.drivers.mavlink.actions.parameters import guard, read_parameter, read_parameters, write_parameter
from bridged.drivers.mavlink.vehicle.readings import NO_OUTPUT, OUTPUTS

PWM_NEAR = 1
"""Microseconds."""
GRIPPER_PWM = {dialect.GRIPPER_ACTION_RELEASE: "GRIP_RELEASE", dialect.GRIPPER_ACTION_GRAB: "GRIP_GRAB"}
"""Parameters of a gripper's PWM, by param2 of DO_GRIPPER."""
FUNCTIONS = tuple(f"SERVO{output}_FUNCTION" for output in range(1, OUTPUTS + 1))
GRIPPER = 28.0
"""SERVOn_FUNCTION of an output that moves a gripper."""
FENCE_ENABLE = "FENCE_ENABLE"
SHOWS_WITHIN, FENCE_SHOWS_WITHIN = (5.0, 3.0), (2.0, 1.5)
"""Mission and wall seconds in which an output, or the fence, must show what was acknowledged."""
RELAYS = 16
"""Relays in RELAY_STATUS."""
LINE_NEAR = 0.1
"""Metres of a winch's line within which it is where it was to be, unless the manifest says otherwise."""
LINE_MOVES_WITHIN = (5.0, 3.0)
"""Mission and wall seconds in which a winch must have moved its line by `LINE_NEAR`, or it has stopped."""
WINCH_REPORTS_WITHIN = (3.0, 2.0)
"""Mission and wall seconds in which a winch answers a request for its state."""


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
    """DO_SET_SERVO: SERVO_OUTPUT_RAW shows the PWM on that output.

    Where an autopilot need not report the output, and does not, the acknowledgement confirms it.
    """
    servo, wanted = int(action.parameters[0]), action.parameters[1]
    if not 1 <= servo <= OUTPUTS:
        return Outcome("refused", f"a servo is one of 1 to {OUTPUTS}, got {servo}")
    action = yield from flight.autopilot.servo(flight, run, action)
    reported = flight.autopilot.outputs_show

    def fits(message: dialect.MAVLink_message) -> bool:
        nonlocal reported
        reported = reported or _pulse(message, servo) != NO_OUTPUT
        return _near(message, servo, wanted)

    outcome = yield from shown(flight, run, action, "SERVO_OUTPUT_RAW", f"servo {servo} at {wanted:g}", fits)
    return outcome if reported else SUCCEEDED


def switch_relay(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_SET_RELAY: RELAY_STATUS shows it; of a vehicle that does not send that, its acknowledgement."""
    relay, on = int(action.parameters[0]), action.parameters[1] >= 1.0
    if not 0 <= relay < RELAYS:
        return Outcome("refused", f"a relay is one of 0 to {RELAYS - 1}, got {relay}")
    bit = 1 << relay
    reports = Seen(flight, run, "RELAY_STATUS", lambda m: bool(m.present & bit) and bool(m.on & bit) == on)
    command = flight.submit(run, action, in_frame=True)
    yield from acknowledged(flight, run, command, reports)
    what = f"relay {relay} {'on' if on else 'off'}"
    run.waits_for = f"RELAY_STATUS to show {what}"
    yield from comes_true(flight, SHOWS_WITHIN, lambda: reports.unavailable or reports())
    if reports() or reports.last is None:
        return SUCCEEDED
    there = f"does not show {what}" if reports.last.present & bit else f"shows no relay {relay}"
    return Outcome("failed", f"{command.name} was acknowledged, but RELAY_STATUS {there}")


def move_winch(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """DO_WINCH by a length (metres out, negative in): WINCH_STATUS shows that much more line, at rest.

    It is sent once: a repetition would release the length twice.
    """
    _, what, length, *_ = action.parameters
    if int(what) != dialect.WINCH_RELATIVE_LENGTH_CONTROL:
        return Outcome("refused", f"a length (param2 = 1) is confirmed by the winch, got the winch action {what:g}")
    before = yield from asked_message(flight, run, "WINCH_STATUS", WINCH_REPORTS_WITHIN)
    if before is None:
        return Outcome("failed", "the vehicle does not report a winch (WINCH_STATUS); has it one?")
    if not math.isfinite(before.line_length):
        return Outcome("failed", "the winch does not know how much line is out (WINCH_STATUS.line_length)")
    goal, near = before.line_length + length, action.tolerance or LINE_NEAR

    def fits(status: dialect.MAVLink_message) -> bool:
        still = not status.status & dialect.MAV_WINCH_STATUS_MOVING
        return still and bool(abs(status.line_length - goal) <= near)

    reports = Seen(flight, run, "WINCH_STATUS", fits)
    command = flight.submit(run, action, lambda: False, in_frame=True)

    def moves() -> bool:
        return reports() or (reports.last is not None and abs(reports.last.line_length - before.line_length) > near)

    yield from acknowledged(flight, run, command, moves)
    line, moved_at = before.line_length, flight.now
    while not reports():
        last = reports.last
        out = last.line_length if last is not None and math.isfinite(last.line_length) else line
        if abs(out - line) >= LINE_NEAR:
            line, moved_at = out, flight.now
        if flight.now - moved_at > flight.wait(*LINE_MOVES_WITHIN):
            return Outcome("failed", f"the winch stopped with {out:.1f} m of line out instead of {goal:.1f} m")
        run.feedback = {"line": round(out, 2), "to_go": round(goal - out, 2)}
        run.waits_for = f"the winch; {out:.1f} of {goal:.1f} m of line are out"
        yield
    return SUCCEEDED


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
        yield from shown(
            flight, run, action, "SERVO_OUTPUT_RAW", f"output {named} at {wanted:g} ({parameter})",
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
    agrees = Seen(flight, run, "SYS_STATUS", lambda m: bool(m.onboard_control_sensors_enabled & bit) == wanted)
    command = flight.submit(run, action, in_frame=True)
    refusal: Ended | None = None
    try:
        yield from acknowledged(flight, run, command, agrees)
    except Ended as ended:
        if command.refused:
            raise
        refusal = ended
    run.waits_for = "SYS_STATUS to show the fence"
    if refusal is None and (yield from comes_true(flight, FENCE_SHOWS_WITHIN, agrees)):
        return SUCCEEDED
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


def shown(flight: ProcedureContext, run: ProcedureRun, action: BoundAction, name: str, what: str, fits: Fits) -> Steps:
    """Send the command; a message of its addressee confirms it, also if the acknowledgement is lost.

    `name`: the message, which is requested; `what` it is to show, for people.
    """
    asked, reports = flight.now, Seen(flight, run, name, fits, action.component)
    command = flight.submit(run, action, in_frame=True)
    yield from acknowledged(flight, run, command, reports)
    run.waits_for = f"{name} to show {what}"
    if (yield from comes_true(flight, SHOWS_WITHIN, reports)):
        return SUCCEEDED
    reason = f"{command.name} was acknowledged, but {name} does not show {what}"
    return Outcome("failed", flight.with_texts(reason, asked))


class Seen:
    """Requests a message of a component repeatedly (0: the autopilot), and knows whether a matching one has arrived."""

    def __init__(self, flight: ProcedureContext, run: ProcedureRun, name: str, fits: Fits, component: int = 0) -> None:
        self.last: dialect.MAVLink_message | None = None
        """The last one that arrived."""
        self._flight, self._name, self._fits = flight, name, fits
        self._sender = component or flight.autopilot_component
        self._poll = Poll(flight, run, name, component=component)
        self._seen = False

    def __call__(self) -> bool:
        """Look at the present message. Returns whether a matching one has arrived so far."""
        self._poll()
        message = self._flight.message
        if message is not None and message.get_type() == self._name and message.get_srcComponent() == self._sender:
            self.last = message
            self._seen = self._seen or self._fits(message)
        return self._seen

    @property
    def unavailable(self) -> bool:
        """Whether the vehicle has refused to send it."""
        return self.last is None and self._poll.refused


def _near(message: dialect.MAVLink_message, servo: int, pwm: float) -> bool:
    return abs(_pulse(message, servo) - pwm) <= PWM_NEAR


def _pulse(message: dialect.MAVLink_message, servo: int) -> int:
    """Return the pulse of an output, 1 to 16; one of port 1 has none."""
    return int(getattr(message, f"servo{servo}_raw")) if message.port == 0 else NO_OUTPUT
