"""Flight modes by number and name, as data: mavutil has them too but costs 30 MB (facts: pymavlink cost)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class ModeTable:
    """The `custom_mode` numbers of one kind of vehicle."""

    names: Mapping[int, str]
    guided: int
    """Takes position targets."""
    hold: int
    """Stays where it is, whatever came before."""
    land: int
    rtl: int
    without_position: frozenset[int]
    """Modes in which the vehicle flies without knowing where it is."""

    @property
    def ordered(self) -> frozenset[int]:
        """The modes in which agents and orders leave a vehicle; one found in another is flown by somebody else."""
        return frozenset({self.guided, self.hold, self.land, self.rtl})

    def name(self, number: int) -> str:
        """The mode's name, or `CMODE(n)` as mavros writes a number that it does not know."""
        return self.names.get(number, f"CMODE({number})")

    def number(self, mode: str | int) -> int:
        """The number of a mode given by name in any case, by `CMODE(n)` or by number. Raises ValueError."""
        if isinstance(mode, int):
            if 0 <= mode < 2**32:
                return mode
            raise ValueError(f"a mode number lies between 0 and {2**32 - 1}, got {mode}")
        wanted = mode.strip().upper()
        for number, name in self.names.items():
            if name == wanted:
                return number
        inner = wanted.removeprefix("CMODE(").removesuffix(")")
        if inner.isascii() and inner.isdigit() and len(inner) <= 9:
            return int(inner)
        raise ValueError(f"no mode {mode!r}; this vehicle has {', '.join(self.names.values())}")


ARDUCOPTER = ModeTable(
    names=MappingProxyType(
        {
            0: "STABILIZE",
            1: "ACRO",
            2: "ALT_HOLD",
            3: "AUTO",
            4: "GUIDED",
            5: "LOITER",
            6: "RTL",
            7: "CIRCLE",
            9: "LAND",
            11: "DRIFT",
            13: "SPORT",
            14: "FLIP",
            15: "AUTOTUNE",
            16: "POSHOLD",
            17: "BRAKE",
            18: "THROW",
            19: "AVOID_ADSB",
            20: "GUIDED_NOGPS",
            21: "SMART_RTL",
            22: "FLOWHOLD",
            23: "FOLLOW",
            24: "ZIGZAG",
            25: "SYSTEMID",
            26: "AUTOROTATE",
            27: "AUTO_RTL",
            28: "TURTLE",
        }
    ),
    guided=4,
    hold=17,
    land=9,
    rtl=6,
    without_position=frozenset({0, 1, 2, 13, 14, 18, 20, 28}),
)
"""ArduPilot ArduCopter/mode.h of 2025-10."""

MODE_TABLES: Mapping[str, ModeTable] = MappingProxyType({"arducopter": ARDUCOPTER})
"""By the manifest's `vehicle`."""
