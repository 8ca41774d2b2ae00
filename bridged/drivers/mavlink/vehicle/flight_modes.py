"""Flight modes by number and name, as data: mavutil has them too but costs 30 MB (facts: pymavlink cost)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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
    booting: frozenset[int] = frozenset()
    """Modes that the vehicle reports while it starts, and leaves by itself."""
    returning: frozenset[int] = frozenset()
    """Modes besides `rtl` in which the vehicle returns by itself."""
    landing: frozenset[int] = frozenset()
    """Modes besides `land` in which it lands by itself."""
    takeoff: int | None = None
    """A mode that takes off by itself, for vehicles that take no command for it."""
    orbit: int | None = None
    """The mode that flies a circle around a place by command."""
    lands: bool = True
    """Whether the mode of the order `land` ends on the ground, disarmed."""
    lands_by_command: bool = True
    """Whether NAV_LAND enters that mode; otherwise it is set."""
    land_otherwise: int | None = None
    """The mode of the order `land` if the vehicle refuses the first."""
    can_stop: bool = True
    """Whether it can stay at a point; a plane cannot."""
    ground: bool = False
    """It never leaves the ground."""
    stay_guided: bool = True
    """A motion that is cancelled ends in GUIDED with the place as its target; otherwise in the mode of `hold`."""
    autopilot: int = dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    """MAV_AUTOPILOT of its HEARTBEAT."""
    synonyms: Mapping[str, int] = field(default_factory=dict)
    """Further names by which a mode may be requested, such as the autopilot's own."""
    also_targets: frozenset[int] = frozenset()
    """Modes besides `guided` in which the vehicle takes position targets, as it leaves them by itself."""
    at_arming: frozenset[int] = frozenset()
    """Modes in which arming starts a flight or a drive by itself."""
    resting: frozenset[int] = frozenset()
    """Modes that the vehicle enters by itself when its motors have stopped."""
    hands_over: bool = True
    """Whether others who set `guided` hand the vehicle over: it is a mode for computers only."""
    also_guided: frozenset[int] = frozenset()
    """Modes besides `guided` that obey agents, and have its name while agents have the vehicle."""
    guided_by_others: str = ""
    """The name of `guided` while others have the vehicle, where it is their mode too."""
    main_and_sub: bool = False
    """A mode is requested by two numbers, which `custom_mode` holds in its third and fourth byte."""

    @property
    def ordered(self) -> frozenset[int]:
        """The modes in which agents and orders leave a vehicle; one found in another is flown by somebody else."""
        by_agents = {self.guided, self.hold, self.land, self.rtl}
        return frozenset(by_agents if self.takeoff is None else by_agents | {self.takeoff})

    @property
    def targets(self) -> frozenset[int]:
        """The modes in which position targets are taken."""
        return self.also_targets | {self.guided}

    def request(self, mode: int) -> tuple[float, float]:
        """Return param2 and param3 of DO_SET_MODE for a mode (custom_mode)."""
        return (float(mode >> 16 & 0xFF), float(mode >> 24)) if self.main_and_sub else (float(mode), 0.0)

    def requested(self, param2: float, param3: float) -> int:
        """Return the mode (custom_mode) that param2 and param3 of DO_SET_MODE request."""
        one, two = int(param2), int(param3)
        return one << 16 | two << 24 if self.main_and_sub and one <= 0xFF else one

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
        if wanted in self.synonyms:
            return self.synonyms[wanted]
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
    land=26,
    rtl=11,
    auto=10,
    after_mission=11,
    booting=frozenset({16}),
    without_position=frozenset({0, 2, 3, 4, 5, 6, 8, 17, 18, 22, 23}),
    returning=frozenset({21}),
    landing=frozenset({20}),
    takeoff=13,
    lands_by_command=False,
    land_otherwise=11,
    can_stop=False,
    stay_guided=False,
)
"""ArduPilot ArduPlane/mode.h of 2025-10. A fixed wing lands by AUTOLAND, along the direction of its takeoff. Where it
refuses that (older versions, a takeoff by hand), the order `land` takes it home (RTL), where it circles or does what
RTL_AUTOLAND says; the order `hold` circles (LOITER)."""

ARDUPLANE_VTOL = replace(
    ARDUPLANE, types=frozenset(range(19, 26)), land=20, landing=frozenset({26}), land_otherwise=None
)
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
    booting=frozenset({16}),
    without_position=frozenset({0, 1, 3, 4, 7, 16}),
    returning=frozenset({12}),
    lands=False,
    ground=True,
    stay_guided=False,
    at_arming=frozenset({10}),
)
"""ArduPilot Rover/mode.h of 2025-10, for cars and boats. The orders `hold` and `land` are both HOLD: it stops."""


def _packed(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


_POSCTL, _TAKEOFF, _LOITER, _MISSION = _packed(3), _packed(4, 2), _packed(4, 3), _packed(4, 4)
_ORBIT, _RTL, _LAND, _OFFBOARD, _DESCEND = _packed(3, 1), _packed(4, 5), _packed(4, 6), _packed(6), _packed(4, 20)
_PX4_NAMES = {
    _packed(1): "MANUAL", _packed(2): "ALTCTL", _POSCTL: "POSCTL", _ORBIT: "ORBIT", _packed(3, 2): "SLOW",
    _packed(4, 1): "READY", _TAKEOFF: "TAKEOFF", _LOITER: "GUIDED", _MISSION: "AUTO", _RTL: "RTL", _LAND: "LAND",
    _packed(4, 8): "FOLLOW", _packed(4, 9): "PRECLAND", _packed(4, 10): "VTOL_TAKEOFF", _packed(4, 19): "COURSE",
    _DESCEND: "DESCEND", _packed(5): "ACRO", _OFFBOARD: "OFFBOARD", _packed(7): "STABILIZED",
    _packed(10): "TERMINATION", _packed(11): "ALTITUDE_CRUISE",
}  # fmt: skip
"""ArduPilot's names where a mode does the same, so that programs fly both: the resting mode of PX4, in which it stays
and takes targets, is GUIDED."""
_PX4_OWN_NAMES = {
    "HOLD": _LOITER, "LOITER": _LOITER, "BRAKE": _LOITER, "AUTO.LOITER": _LOITER, "MISSION": _MISSION,
    "AUTO.MISSION": _MISSION, "AUTO.RTL": _RTL, "AUTO.LAND": _LAND, "AUTO.TAKEOFF": _TAKEOFF,
    "AUTO.PRECLAND": _packed(4, 9), "AUTO.FOLLOW": _packed(4, 8), "POSHOLD": _POSCTL, "STABILIZE": _packed(7),
    "ALT_HOLD": _packed(2),
}  # fmt: skip

PX4_COPTER = ModeTable(
    vehicle="copter",
    autopilot=dialect.MAV_AUTOPILOT_PX4,
    types=ARDUCOPTER.types,
    names=MappingProxyType(_PX4_NAMES),
    synonyms=MappingProxyType(_PX4_OWN_NAMES),
    guided=_LOITER,
    hold=_LOITER,
    land=_LAND,
    rtl=_RTL,
    auto=_MISSION,
    after_mission=_LOITER,
    without_position=frozenset(map(_packed, (1, 2, 5, 7, 11))),
    landing=frozenset({_packed(4, 9), _DESCEND}),
    takeoff=_TAKEOFF,
    orbit=_ORBIT,
    stay_guided=False,
    also_targets=frozenset({_TAKEOFF, _OFFBOARD, _ORBIT}),
    at_arming=frozenset({_TAKEOFF, _MISSION}),
    resting=frozenset({_LOITER}),
    hands_over=False,
    also_guided=frozenset({_OFFBOARD, _TAKEOFF, _ORBIT}),
    guided_by_others="HOLD",
    main_and_sub=True,
)
"""PX4 main of 2026-08 (px4_custom_mode.h). A pilot's Hold is the mode that takes targets too, so only an agent takes
control again, by setting the mode."""

PX4_PLANE = replace(
    PX4_COPTER,
    vehicle="plane",
    types=ARDUPLANE.types,
    land=_RTL,
    landing=frozenset({_LAND, _DESCEND}),
    lands=False,
    can_stop=False,
    orbit=None,
    also_guided=frozenset({_OFFBOARD}),
)
"""A fixed wing's AUTO.LAND descends wherever it is, so the order `land` takes it home (RTL), where it circles or flies
the landing of its mission (RTL_TYPE)."""

PX4_VTOL = replace(
    PX4_COPTER, vehicle="plane", types=ARDUPLANE_VTOL.types, can_stop=False, also_guided=frozenset({_OFFBOARD})
)
"""A plane that reports vertical takeoff: it lands by AUTO.LAND."""

PX4_ROVER = replace(PX4_COPTER, vehicle="rover", types=ARDUROVER.types, ground=True, takeoff=None, orbit=None)
"""Cars and boats: AUTO.LAND stops it and then its motors."""

PX4_OFFBOARD = _OFFBOARD
"""Takes setpoints, and only while they are streamed."""

MODE_TABLES: Mapping[str, ModeTable] = MappingProxyType(
    {table.vehicle: table for table in (ARDUCOPTER, ARDUPLANE, ARDUROVER)}
)
"""By the manifest's `vehicle`, as long as the autopilot of the vehicle is not known."""

_BY_HEARTBEAT = {
    (table.autopilot, kind): table
    for table in (
        ARDUCOPTER, ARDUPLANE, ARDUPLANE_VTOL, ARDUROVER, PX4_COPTER, PX4_PLANE, PX4_VTOL, PX4_ROVER,
    )
    for kind in table.types
}  # fmt: skip

COMING_HOME: frozenset[str] = frozenset(
    name
    for table in _BY_HEARTBEAT.values()
    for mode, name in table.names.items()
    if table.order_of(mode) in ("rtl", "land")
)
"""Names of the modes in which a vehicle of any kind returns or lands by itself."""


def table_of(declared: ModeTable, autopilot: int, kind: int) -> ModeTable:
    """Return the table of a vehicle of this MAV_AUTOPILOT and MAV_TYPE: as it is, not as the manifest says.

    Of a type that is not known the declared kind counts; the modes of an unknown autopilot have numbers only.
    """
    if (known := _BY_HEARTBEAT.get((autopilot, kind))) is not None:
        return known
    for table in _BY_HEARTBEAT.values():
        if (table.autopilot, table.vehicle) == (autopilot, declared.vehicle):
            return table
    return replace(declared, names=MappingProxyType({}))


def simulated_table(autopilot: str, vehicle: str) -> ModeTable:
    """Return the table of a simulated vehicle: `ardupilot` or `px4`, and the `vehicle` of its manifest."""
    number = dialect.MAV_AUTOPILOT_PX4 if autopilot == "px4" else dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
    return table_of(MODE_TABLES[vehicle], number, dialect.MAV_TYPE_GENERIC)


def contradiction(declared: ModeTable, kind: int) -> str:
    """Return a text that a MAV_TYPE is not of the manifest's vehicle; empty if it may be."""
    known = _BY_HEARTBEAT.get((dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, kind))
    if kind == dialect.MAV_TYPE_GENERIC or (known is not None and known.vehicle == declared.vehicle):
        return ""
    entry = dialect.enums["MAV_TYPE"].get(kind)
    name = entry.name if entry else f"MAV_TYPE {kind}"
    instead = f'; `vehicle = "{known.vehicle}"` would fit' if known is not None else ""
    return f"the vehicle reports that it is a {name}, the manifest says {declared.vehicle}{instead}"
