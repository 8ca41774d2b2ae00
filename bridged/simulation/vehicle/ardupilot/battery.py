"""The battery of the simulated copter: voltage, charge, shortages.

The recorded simulated battery kept 12.6 V whatever was taken out of it, which is what SIM_BATT_CAP_AH = 0 means in
ArduPilot's simulator too. With a capacity the voltage falls with the charge, and an empty battery stops the motors.
"""

from dataclasses import dataclass
from enum import IntEnum

from bridged.simulation.vehicle.autopilot import CHARGE_S, ChargeState
from bridged.simulation.vehicle.parameters import Parameters

HOVER_CURRENT = 28.12
"""A, recorded."""

HIGHEST_VOLTAGE = 60.0
"""V; the limit of SIM_BATT_VOLTAGE and of BATTERY_STATUS."""

HOME_RADIUS = 5.0
"""m around home within which the vehicle is charged while its motors are off."""

_AT_REST = ((0.0, 0.79), (0.05, 0.85), (0.2, 0.885), (0.5, 0.92), (0.8, 0.96), (1.0, 1.0))
"""Open-circuit voltage of a lithium battery by remaining charge, both as shares of the full values."""

_RESISTANCE = 0.01
"""Ohm."""


def battery_parameters(minutes: float) -> list[tuple[str, float]]:
    """Return the parameters of a battery that lasts `minutes` in the air."""
    amperehours = HOVER_CURRENT * minutes / 60
    return [("SIM_BATT_CAP_AH", amperehours), ("BATT_CAPACITY", amperehours * 1000)]


class Shortage(IntEnum):
    """State of the battery failsafe."""

    NONE = 0
    LOW = 1
    CRITICAL = 2


@dataclass(slots=True)
class Battery:
    """Charge counter with the limits of the BATT_ parameters."""

    parameters: Parameters
    charge_time: float = CHARGE_S
    used: float = 0.0  # mAh
    current: float = 0.0  # A
    charging: bool = False
    shortage: Shortage = Shortage.NONE
    _low_since: float | None = None

    def step(self, dt: float, *, flying: bool, effort: float = 1.0) -> None:
        """Draw `effort` times the current of a hover for `dt` seconds, or none."""
        self.current = HOVER_CURRENT * effort if flying else 0.0
        self.used += self.current * dt / 3.6
        self.charging = False

    def rest(self, dt: float, *, at_home: bool) -> None:
        """Motors off for `dt` seconds; charge the battery at home."""
        self.current = 0.0
        self.charging = at_home and self.used > 0
        if self.charging:
            self.used = max(0.0, self.used - self._capacity * dt / self.charge_time)
        if self.used == 0:
            self.shortage, self._low_since = Shortage.NONE, None

    @property
    def _capacity(self) -> float:
        real = self.parameters["SIM_BATT_CAP_AH"] * 1000
        return max(1.0, real if real > 0 else self.parameters["BATT_CAPACITY"])

    @property
    def empty(self) -> bool:
        """Whether the charge is used up; never for a battery without SIM_BATT_CAP_AH."""
        return self.parameters["SIM_BATT_CAP_AH"] > 0 and self.used >= self._capacity

    @property
    def remaining(self) -> int:
        """Per cent of BATT_CAPACITY, which the autopilot counts; the real charge is unknown to it."""
        return max(0, min(100, round(100 * (1 - self.used / max(1.0, self.parameters["BATT_CAPACITY"])))))

    @property
    def voltage(self) -> float:
        """V"""
        full = max(0.0, min(HIGHEST_VOLTAGE, self.parameters["SIM_BATT_VOLTAGE"]))
        if self.parameters["SIM_BATT_CAP_AH"] <= 0:
            return full
        left, (low, share) = max(0.0, 1 - self.used / self._capacity), _AT_REST[0]
        for high, more in _AT_REST[1:]:
            if left <= high:
                share += (more - share) * (left - low) / (high - low)
                break
            low, share = high, more
        return full * share - self.current * _RESISTANCE

    @property
    def state(self) -> ChargeState:
        """charge_state of BATTERY_STATUS."""
        if self.charging:
            return ChargeState.CHARGING
        return {Shortage.NONE: ChargeState.OK, Shortage.LOW: ChargeState.LOW}.get(self.shortage, ChargeState.CRITICAL)

    def check(self, now: float) -> Shortage | None:
        """Return a new shortage: voltage below its limit for BATT_LOW_TIMER seconds, or too little charge left."""
        values, voltage = self.parameters, self.voltage
        worse = self._below(values["BATT_CRT_VOLT"], voltage) or self._short_of(values["BATT_CRT_MAH"])
        bad = worse or self._below(values["BATT_LOW_VOLT"], voltage) or self._short_of(values["BATT_LOW_MAH"])
        if not bad:
            self._low_since = None
            return None
        self._low_since = now if self._low_since is None else self._low_since
        found = Shortage.CRITICAL if worse else Shortage.LOW
        if found <= self.shortage or now - self._low_since < values["BATT_LOW_TIMER"]:
            return None
        self.shortage = found
        return found

    def _below(self, limit: float, voltage: float) -> bool:
        return limit > 0 and voltage < limit

    def _short_of(self, limit: float) -> bool:
        return limit > 0 and self.parameters["BATT_CAPACITY"] - self.used < limit
