"""Flight modes of PX4: `custom_mode` holds a main mode in its third byte and a sub mode in its fourth."""

from enum import IntEnum


def packed(main: int, sub: int = 0) -> int:
    """Return the custom_mode of a main and a sub mode."""
    return main << 16 | sub << 24


class Mode(IntEnum):
    """custom_mode of HEARTBEAT."""

    MANUAL = packed(1)
    ALTCTL = packed(2)
    POSCTL = packed(3)
    ORBIT = packed(3, 1)
    SLOW = packed(3, 2)
    TAKEOFF = packed(4, 2)
    LOITER = packed(4, 3)
    MISSION = packed(4, 4)
    RTL = packed(4, 5)
    LAND = packed(4, 6)
    FOLLOW = packed(4, 8)
    PRECLAND = packed(4, 9)
    VTOL_TAKEOFF = packed(4, 10)
    COURSE = packed(4, 19)
    DESCEND = packed(4, 20)
    ACRO = packed(5)
    OFFBOARD = packed(6)
    STABILIZED = packed(7)
    TERMINATION = packed(10)
    ALTITUDE_CRUISE = packed(11)

    @property
    def piloted(self) -> bool:
        """Whether the pilot's sticks move the vehicle, and it is refused in flight without them."""
        return self in _PILOTED

    @property
    def automatic(self) -> bool:
        """Whether it is an AUTO mode."""
        return self >> 16 & 0xFF == AUTO


AUTO = 4
"""Main mode of those that fly by themselves."""

_PILOTED = frozenset((
    Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.SLOW, Mode.ACRO, Mode.STABILIZED, Mode.ALTITUDE_CRUISE,
))  # fmt: skip

_NAMES = {
    Mode.MANUAL: "Manual", Mode.ALTCTL: "Altitude", Mode.POSCTL: "Position", Mode.SLOW: "Position Slow",
    Mode.ACRO: "Acro", Mode.STABILIZED: "Stabilized", Mode.ALTITUDE_CRUISE: "Altitude Cruise",
    Mode.OFFBOARD: "Offboard", Mode.MISSION: "Mission", Mode.LOITER: "Hold", Mode.RTL: "Return", Mode.LAND: "Land",
    Mode.TAKEOFF: "Takeoff",
}  # fmt: skip

STANDARD = {Mode.ALTCTL: 4, Mode.POSCTL: 1, Mode.MISSION: 6, Mode.RTL: 5, Mode.TAKEOFF: 8, Mode.LAND: 7, Mode.ORBIT: 2}
"""standard_mode of CURRENT_MODE and AVAILABLE_MODES (MAV_STANDARD_MODE), 0 for others."""

_CANNOT_BE_SET, _UNAVAILABLE = 2, 3
AVAILABLE: tuple[tuple[int, int, str], ...] = (
    (Mode.MANUAL, 1, "Manual"),
    (Mode.ALTCTL, 0, ""),
    (Mode.POSCTL, 0, ""),
    (Mode.MISSION, 1, ""),
    (Mode.LOITER, 1, "Hold"),
    (Mode.RTL, 1, ""),
    (Mode.SLOW, 1, "Position Slow"),
    (Mode.COURSE, 1, "Guided Course"),
    (Mode.ALTITUDE_CRUISE, 1, "Altitude Cruise"),
    (Mode.ACRO, 1, "Acro"),
    (Mode.DESCEND, _UNAVAILABLE, "Descend"),
    (Mode.TERMINATION, _UNAVAILABLE, "Termination"),
    (Mode.OFFBOARD, 1, "Offboard"),
    (Mode.STABILIZED, 1, "Stabilized"),
    (Mode.TAKEOFF, 1, ""),
    (Mode.LAND, 1, ""),
    (Mode.FOLLOW, 1, "Follow Target"),
    (Mode.PRECLAND, 1, "Precision Landing"),
    (Mode.ORBIT, 1, ""),
    (Mode.VTOL_TAKEOFF, 1, "VTOL Takeoff"),
    *((packed(4, external), _CANNOT_BE_SET, "(Mode not available)") for external in range(11, 19)),
)
"""custom_mode, properties and mode_name of AVAILABLE_MODES, in the recorded order."""

_SELECTABLE: dict[int, Mode] = {
    packed(AUTO): Mode.MISSION,
    **{int(mode): mode for mode in Mode if mode not in (Mode.ORBIT, Mode.DESCEND, Mode.TERMINATION)},
}


def name_of(mode: Mode) -> str:
    """Return the name of a mode as texts have it."""
    return _NAMES.get(mode, mode.name.title())


def selected(main: int, sub: int) -> Mode | None:
    """Return the mode that a main and a sub mode select; None: there is none, or it cannot be selected."""
    return _SELECTABLE.get(packed(main, sub)) if 0 <= main < 256 and 0 <= sub < 256 else None
