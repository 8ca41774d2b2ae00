"""RC input of the autopilot: the pilot's transmitter, and overrides of a ground station."""

import math
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.motion.dynamics import Motion, Vector
from bridged.simulation.vehicle.motion.tasks import Drift
from bridged.simulation.vehicle.parameters import Parameters

CHANNELS = 16
RESTING = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800, *([0] * (CHANNELS - 8)))
"""Pulses in µs of an untouched transmitter: sticks centred, throttle down."""

DEAD_ZONE = 30
"""Microseconds around the middle in which a stick counts as centred."""

STICK_LASTS_S = 0.5
"""Seconds that a stick's velocity holds; sticks are read more often than this."""

FASTEST = 35.0
"""m/s; the limit of LOIT_SPEED."""

FASTEST_TURN = math.radians(60.0)
"""rad/s of a yaw stick at its end."""

_KEEP, _RELEASE = 65535, 65534
_FIRST_EXTENDED = 9
"""RC_CHANNELS_OVERRIDE: 65535 leaves a channel as it is; 0 gives channels 1 to 8 back, 65534 those from 9 on."""

_MODE_SWITCH_STEPS = (1230, 1360, 1490, 1620, 1749)
"""Microseconds between the six positions of the flight mode switch."""


@dataclass(slots=True)
class Transmitter:
    """RC_CHANNELS. An override expires RC_OVERRIDE_TIME seconds after its last message; `now`: vehicle seconds."""

    parameters: Parameters
    _overrides: dict[int, tuple[int, float]] = field(default_factory=dict)  # pulse, time of receipt
    _switch: int | None = None
    _pushed: bool = False

    def override(self, message: dialect.MAVLink_message, now: float) -> None:
        """RC_CHANNELS_OVERRIDE; taken from system MAV_GCS_SYSID only, others are ignored in silence (ArduPilot)."""
        if message.get_srcSystem() != int(self.parameters["MAV_GCS_SYSID"]):
            return
        for channel in range(1, CHANNELS + 1):
            pulse = getattr(message, f"chan{channel}_raw")
            if channel >= _FIRST_EXTENDED:
                pulse = {0: _KEEP, _RELEASE: 0}.get(pulse, pulse)
            if pulse == 0:
                self._overrides.pop(channel, None)
            elif pulse != _KEEP:
                self._overrides[channel] = (pulse, now)

    def pulse(self, channel: int, now: float) -> int:
        """Return the pulse of a `channel` (from 1) at `now` (vehicle seconds), in µs."""
        moved = self._moved(channel, now)
        return RESTING[channel - 1] if moved is None else moved

    def pulses(self, now: float) -> list[int]:
        """Return the pulses of all channels, in µs, at a time in vehicle seconds."""
        return [self.pulse(channel, now) for channel in range(1, CHANNELS + 1)]

    def stick(self, name: str, now: float) -> float:
        """Return the position of an overridden stick from -1 to 1; 0 without an override. `name` as in RCMAP_ROLL."""
        pulse = self._moved(int(self.parameters[f"RCMAP_{name}"]), now)
        if pulse is None or abs(pulse - 1500) <= DEAD_ZONE:
            return 0.0
        return max(-1.0, min(1.0, (pulse - 1500) / 500))

    @property
    def touched(self) -> bool:
        """Whether any channel is overridden."""
        return bool(self._overrides)

    def switched_mode(self, now: float) -> int | None:
        """Return the mode of the flight mode switch when an override has moved it, else None."""
        pulse = self._moved(int(self.parameters["FLTMODE_CH"]), now)
        position = None if pulse is None else sum(pulse > step for step in _MODE_SWITCH_STEPS)
        if position == self._switch:
            return None
        self._switch = position
        return None if position is None else int(self.parameters[f"FLTMODE{position + 1}"])

    def drift(self, motion: Motion, now: float) -> Drift | None:
        """Return how overridden sticks move a vehicle at `now` (s); None if they do not.

        All modes that obey sticks do as LOITER does: a stick is a speed.
        """
        right, back, up, turn = (self.stick(name, now) for name in ("ROLL", "PITCH", "THROTTLE", "YAW"))
        pushes = bool(right or back or up or turn)
        if not pushes and not self._pushed:
            return None
        self._pushed = pushes
        speed, climb = min(FASTEST, abs(self.parameters["LOIT_SPEED"]) / 100), self.parameters["PILOT_SPEED_UP"] / 100
        north, east = motion.turned(-back, right)
        velocity = Vector(north * speed, east * speed, up * climb)
        return Drift(velocity, now + STICK_LASTS_S, turn_rate=turn * FASTEST_TURN if turn else None)

    def _moved(self, channel: int, now: float) -> int | None:
        if channel not in self._overrides:
            return None
        pulse, since = self._overrides[channel]
        lasts = self.parameters["RC_OVERRIDE_TIME"]
        if lasts == 0 or (lasts > 0 and now - since > lasts):
            del self._overrides[channel]
            return None
        return pulse
