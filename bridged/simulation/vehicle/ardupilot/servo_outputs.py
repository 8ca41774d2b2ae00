"""Servo outputs of a simulated copter, and a gripper on one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from bridged.simulation.vehicle.ardupilot.parameters import SERVOS
from bridged.simulation.vehicle.parameters import Parameters

NOT_DRIVEN, MANUAL, GRIPPER = 0, 1, 28
"""Values of SERVOn_FUNCTION; 33 to 36 are the motors."""

_FREE_FUNCTIONS = frozenset((NOT_DRIVEN, MANUAL, GRIPPER, *range(51, 67), *range(94, 110)))
"""Functions of outputs that DO_SET_SERVO may move (ArduPilot): none, manual, gripper, RC inputs, scripts."""

GRIPPER_TIME_S = 3.0
"""From the order until the gripper holds or lets go (ArduPilot's servo gripper)."""

OFF, HIGHEST = 1000, 65535
"""Microseconds."""

_MOTOR_IDLE, _MOTOR_HOVER = 1150, 1520


class Grip(IntEnum):
    """Parameter 2 of MAV_CMD_DO_GRIPPER (GRIPPER_ACTIONS)."""

    RELEASE = 0
    GRAB = 1


_TEXTS = {
    Grip.RELEASE: ("Gripper load releasing", "Gripper load released"),
    Grip.GRAB: ("Gripper load grabbing", "Gripper load grabbed"),
}


@dataclass(slots=True)
class _Repeat:
    """MAV_CMD_DO_REPEAT_SERVO: to and fro between a position and the trim of the output."""

    channel: int
    positions: list[int]
    period: float
    next_at: float


class Outputs:
    """Servo outputs by their numbers from 1. An output that was never set gives no pulse (0).

    Pulses are in microseconds; `now` is in vehicle seconds.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._pulses: dict[int, int] = {}
        self._repeat: _Repeat | None = None
        self._gripping: tuple[Grip, float] | None = None
        self.on_move: Callable[[int, int], None] = lambda channel, pulse: None
        """Called with each output and its new pulse in microseconds."""

    def function(self, channel: int) -> int:
        """Return SERVOn_FUNCTION of a channel (from 1); -1 for an unknown output."""
        return int(self._parameters[f"SERVO{channel}_FUNCTION"]) if 1 <= channel <= SERVOS else -1

    def pulses(self, *, armed: bool, airborne: bool) -> list[int]:
        """Return the pulses of all outputs in µs, as in SERVO_OUTPUT_RAW."""
        motor = OFF if not armed else _MOTOR_HOVER if airborne else _MOTOR_IDLE
        motors = range(33, 37)
        numbers = range(1, SERVOS + 1)
        return [motor if self.function(one) in motors else _possible(self._pulses.get(one, 0)) for one in numbers]

    def set(self, channel: int, pulse: int) -> str | None:
        """MAV_CMD_DO_SET_SERVO: `pulse` in µs, `channel` from 1.

        Returns the reason of a refusal, as the vehicle words it.
        """
        problem = self._problem_with(channel)
        if problem is None:
            self._repeat = None if self._repeat is not None and self._repeat.channel == channel else self._repeat
            self._move(channel, pulse)
        return problem

    def repeat(self, channel: int, pulse: int, times: int, period: float, now: float) -> str | None:
        """MAV_CMD_DO_REPEAT_SERVO: `channel` (from 1) to `pulse` (µs) and back, `times` times, from `now` on.

        A cycle takes `period` seconds. Returns the reason of a refusal.
        """
        problem = self._problem_with(channel)
        if problem is None:
            trim = int(self._parameters[f"SERVO{channel}_TRIM"])
            self._repeat = _Repeat(channel, [pulse, trim] * max(0, min(times, 1000)), max(0.1, period / 2), now)
        return problem

    def grip(self, action: Grip, now: float) -> str:
        """MAV_CMD_DO_GRIPPER; returns the status text."""
        self._gripping = (action, now + GRIPPER_TIME_S)
        pulse = int(self._parameters["GRIP_GRAB" if action is Grip.GRAB else "GRIP_RELEASE"])
        for channel in range(1, SERVOS + 1):
            if self.function(channel) == GRIPPER:
                self._move(channel, pulse)
        return _TEXTS[action][0]

    def step(self, now: float) -> str | None:
        """Advance repeated moves and the gripper; returns a status text, if any."""
        repeat = self._repeat
        if repeat is not None and now >= repeat.next_at:
            if repeat.positions:
                self._move(repeat.channel, repeat.positions.pop(0))
                repeat.next_at = now + repeat.period
            else:
                self._repeat = None
        if self._gripping is not None and now >= self._gripping[1]:
            (action, _), self._gripping = self._gripping, None
            return _TEXTS[action][1]
        return None

    def _move(self, channel: int, pulse: int) -> None:
        if self._pulses.get(channel) != pulse:
            self._pulses[channel] = pulse
            self.on_move(channel, _possible(pulse))

    def _problem_with(self, channel: int) -> str | None:
        function = self.function(channel)
        if function in _FREE_FUNCTIONS:
            return None
        return (
            f"ServoRelayEvent: Channel {channel} is already in use" if function >= 0 else f"No servo output {channel}"
        )


def _possible(pulse: int) -> int:
    return max(0, min(HIGHEST, pulse))
