"""Flight modes by number and name, as data: mavutil has them too but costs 30 MB (facts: pymavlink cost)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Order


@dataclass(frozen=True)
class ModeTable:
    """The `custom_mode` numbers of one kind of vehicle, and what the orders from above the agents mean for it."""

    vehicle: str
    """As a manifest names it."""
    types: frozenset[int]
    """MAV_TYPE of the HEARTBEATs of such vehicles."""
    names: Mapping[int, str]
    guided: int
    """Takes position targets."""
    hold: int
    """The order `hold`: stays where it is (a plane circles there), whatever came before."""
    land: int
    """The order `land`."""
    rtl: int
    """The order `rtl`."""
    auto: int
    """Flies the stored mission."""
    after_mission: int
    """The mode that the vehicle is in when the mission is over: `auto`, or what it goes to by itself."""
    without_position: frozenset[int]
    """Modes in which the vehicle flies without knowing where it is."""
    returning: frozenset[int] = frozenset()
    """Modes besides `rtl` in which the vehicle returns by itself."""
    landing: frozenset[int] = frozenset()
    """Modes besides `land` in which it lands by itself."""
    takeoff: int | None = None
    """A mode that takes off by itself, for vehicles that take no command for it."""
    lands: bool = True
    """Whether the mode of the order `land` ends on the ground, disarmed."""
    can_stop: bool = True
    """Whether it can stay at a point; a plane cannot."""
    ground: bool = False
    """It never leaves the ground."""
    stay_guided: bool = True
    """A motion that is cancelled ends in GUIDED with the place as its target; otherwise in the mode of `hold`."""

    @property
    def ordered(self) -> frozenset[int]:
        """The modes in which agents and orders leave a vehicle; one found in another is flown by somebody else."""
        return frozenset({self.guided, self.hold, self.land, self.rtl})

    def order_of(self, mode: int) -> Order | None:
        """The order that a mode carries out; of several with one mode the least safe, so that the others still count.

        A rover's HOLD is `hold` and not `land`: `rtl` may follow it.
        """
        if mode == self.hold:
            return "hold"
        if mode == self.rtl or mode in self.returning:
            return "rtl"
        return "land" if mode == self.land or mode in self.landing else None

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


def _names(enum: str, otherwise: Mapping[int, str]) -> Mapping[int, str]:
    """Return MAVLink's names of modes by number; `otherwise`: those that mavros and ground stations call otherwise."""
    entries = dialect.enums[enum].items()
    names = {number: entry.name.removeprefix(f"{enum}_") for number, entry in entries}
    return MappingProxyType({number: name for number, name in names.items() if name != "ENUM_END"} | dict(otherwise))


ARDUCOPTER = ModeTable(
    vehicle="copter",
    types=frozenset({2, 3, 4, 13, 14, 15, 29, 35}),
    names=_names("COPTER_MODE", {}),
    guided=4,
    hold=17,
    land=9,
    rtl=6,
    auto=3,
    after_mission=3,
    without_position=frozenset({0, 1, 2, 13, 14, 18, 20, 28}),
    returning=frozenset({21, 27}),
)
"""ArduPilot ArduCopter/mode.h of 2025-10."""

ARDUPLANE = ModeTable(
    vehicle="plane",
    types=frozenset({1}),
    names=_names("PLANE_MODE", {5: "FBWA", 6: "FBWB", 16: "INITIALISING", 25: "LOITERALTQLAND"}),
    guided=15,
    hold=12,
    land=11,
    rtl=11,
    auto=10,
    after_mission=11,
    without_position=frozenset({0, 2, 3, 4, 5, 6, 8, 17, 18, 22, 23}),
    returning=frozenset({21}),
    landing=frozenset({20, 26}),
    takeoff=13,
    lands=False,
    can_stop=False,
    stay_guided=False,
)
"""ArduPilot ArduPlane/mode.h of 2025-10. A fixed wing has no mode that lands wherever it is, so the order `land` takes
it home (RTL), where it circles or does what RTL_AUTOLAND says; the order `hold` circles (LOITER)."""

ARDUPLANE_VTOL = replace(ARDUPLANE, types=frozenset(range(19, 26)), land=20, lands=True)
"""A plane that reports vertical takeoff: the order `land` is QLAND."""

ARDUROVER = ModeTable(
    vehicle="rover",
    types=frozenset({10, 11}),
    names=_names("ROVER_MODE", {16: "INITIALISING"}),
    guided=15,
    hold=4,
    land=4,
    rtl=11,
    auto=10,
    after_mission=4,
    without_position=frozenset({0, 1, 3, 4, 7, 16}),
    returning=frozenset({12}),
    lands=False,
    ground=True,
    stay_guided=False,
)
"""ArduPilot Rover/mode.h of 2025-10, for cars and boats. The orders `hold` and `land` are both HOLD: it stops."""

MODE_TABLES: Mapping[str, ModeTable] = MappingProxyType(
    {table.vehicle: table for table in (ARDUCOPTER, ARDUPLANE, ARDUROVER)}
)
"""By the manifest's `vehicle`."""

_BY_TYPE = {kind: table for table in (ARDUCOPTER, ARDUPLANE, ARDUPLANE_VTOL, ARDUROVER) for kind in table.types}

COMING_HOME: frozenset[str] = frozenset(
    name for table in _BY_TYPE.values() for mode, name in table.names.items() if table.order_of(mode) in ("rtl", "land")
)
"""Names of the modes in which a vehicle of any kind returns or lands by itself."""


def table_of(declared: ModeTable, kind: int) -> ModeTable:
    """The table of a vehicle of this MAV_TYPE: as it is, not as the manifest says; `declared` if nothing is known."""
    return _BY_TYPE.get(kind, declared)


def nameless(declared: ModeTable) -> ModeTable:
    """The table of an autopilot whose modes are not known: each is called by its number."""
    return replace(declared, names=MappingProxyType({}))


def contradiction(declared: ModeTable, kind: int) -> str:
    """Return a text that a MAV_TYPE is not of the manifest's vehicle; empty if it may be."""
    known = _BY_TYPE.get(kind)
    if kind == dialect.MAV_TYPE_GENERIC or (known is not None and known.vehicle == declared.vehicle):
        return ""
    entry = dialect.enums["MAV_TYPE"].get(kind)
    name = entry.name if entry else f"MAV_TYPE {kind}"
    instead = f'; `vehicle = "{known.vehicle}"` would fit' if known is not None else ""
    return f"the vehicle reports that it is a {name}, the manifest says {declared.vehicle}{instead}"
