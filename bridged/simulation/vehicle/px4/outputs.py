"""Outputs of a simulated PX4: the pulses of what parameters assign to them, and DO_SET_ACTUATOR."""

import math
from collections.abc import Callable

from bridged.simulation.vehicle.parameters import Parameters
from bridged.simulation.vehicle.px4.parameters import OUTPUTS

MOTORS = range(101, 113)
"""PWM_MAIN_FUNCn of motors ..."""
ACTUATORS = range(301, 307)
"""... and of what DO_SET_ACTUATOR sets."""
ALWAYS = 2.0
"""COM_PREARM_MODE: outputs other than motors move disarmed, too."""
_IDLE, _HOVER = 0.1, 0.5
"""Shares of the range of a motor's pulses."""


class Outputs:
    """MAIN outputs by their numbers from 1; pulses are in microseconds."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._values = [math.nan] * len(ACTUATORS)
        """Of the actuators, -1 to 1; NaN: never set."""
        self._shown: list[int] = []
        self.on_move: Callable[[int, int], None] = lambda output, pulse: None
        """Called with each output of an actuator and its new pulse."""

    def set(self, values: tuple[float, ...]) -> None:
        """DO_SET_ACTUATOR: all six values, -1 to 1; NaN gives the pulse of a disarmed output."""
        self._values = list(values)

    def pulses(self, *, armed: bool, airborne: bool) -> list[int]:
        """Return the pulses of all outputs, as in SERVO_OUTPUT_RAW; what was never set has its disarmed pulse."""
        motor = (_HOVER if airborne else _IDLE) if armed else math.nan
        moves = armed or self._parameters["COM_PREARM_MODE"] == ALWAYS
        return [self._pulse(output, motor, moves=moves) for output in range(1, OUTPUTS + 1)]

    def look(self, *, armed: bool, airborne: bool) -> None:
        """Report the outputs of actuators that have moved since the last look."""
        pulses = self.pulses(armed=armed, airborne=airborne)
        was, self._shown = self._shown or pulses, pulses
        for output, (old, new) in enumerate(zip(was, pulses, strict=True), 1):
            if old != new and self._function(output) in ACTUATORS:
                self.on_move(output, new)

    def _function(self, output: int) -> int:
        return int(self._parameters[f"PWM_MAIN_FUNC{output}"])

    def _pulse(self, output: int, motor: float, *, moves: bool) -> int:
        function, value = self._function(output), math.nan
        if function in MOTORS:
            value = 2 * motor - 1
        elif function in ACTUATORS and moves:
            value = self._values[function - ACTUATORS[0]]
        low, high, resting = (self._parameters[f"PWM_MAIN_{what}{output}"] for what in ("MIN", "MAX", "DIS"))
        if not math.isfinite(value):
            return int(resting)
        if int(self._parameters["PWM_MAIN_REV"]) >> (output - 1) & 1:
            value = -value
        return int(max(low, min(high, value * (high - low) / 2 + (high + low) / 2 + 0.01)))
