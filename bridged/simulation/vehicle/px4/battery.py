"""The battery of the simulated PX4: charge falls by time while the motors turn, as in its simulator."""

from dataclasses import dataclass

from bridged.simulation.vehicle.autopilot import CHARGE_S, ChargeState
from bridged.simulation.vehicle.parameters import Parameters

CELLS = 4
_EMPTY_V, _RANGE_V = 3.6, 0.45
"""Volts of a cell that is empty, and what a full one has more (recorded: 16.2 V full, 15.3 V half)."""


def battery_parameters(minutes: float) -> list[tuple[str, float]]:
    """Return the parameters of a battery that lasts `minutes` in the air."""
    return [("SIM_BAT_DRAIN", 60 * minutes), ("SIM_BAT_MIN_PCT", 0.0)]


@dataclass(slots=True)
class Battery:
    """Charge from 0 to 1. It stops at SIM_BAT_MIN_PCT: if that is 0 it is charged at home, else full when disarmed."""

    parameters: Parameters
    charge_time: float = CHARGE_S
    charge: float = 1.0

    @property
    def runs_down(self) -> bool:
        """Whether it can become empty."""
        return self.parameters["SIM_BAT_MIN_PCT"] <= 0

    @property
    def empty(self) -> bool:
        """Whether the charge is used up."""
        return self.runs_down and self.charge <= 0

    @property
    def remaining(self) -> int:
        """Per cent."""
        return round(100 * self.charge)

    @property
    def voltage(self) -> float:
        """V"""
        return CELLS * (_EMPTY_V + _RANGE_V * self.charge)

    @property
    def state(self) -> ChargeState:
        """What the charge is by the BAT_ parameters."""
        for name, state in (
            ("BAT_EMERGEN_THR", ChargeState.EMERGENCY),
            ("BAT_CRIT_THR", ChargeState.CRITICAL),
            ("BAT_LOW_THR", ChargeState.LOW),
        ):
            if self.charge < self.parameters[name]:
                return state
        return ChargeState.OK

    def step(self, dt: float) -> None:
        """Motors on for `dt` seconds."""
        lowest = self.parameters["SIM_BAT_MIN_PCT"] / 100
        self.charge = max(min(self.charge, lowest), self.charge - dt / max(1.0, self.parameters["SIM_BAT_DRAIN"]))

    def rest(self, dt: float, *, at_home: bool) -> None:
        """Motors off for `dt` seconds."""
        if not self.runs_down:
            self.charge = 1.0
        elif at_home:
            self.charge = min(1.0, self.charge + dt / self.charge_time)
