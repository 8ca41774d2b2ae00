"""Items of a mission, from the terms of a plan and from MISSION_ITEM_INT."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Value
from bridged.drivers.mavlink.vehicle.state import Place

MAX_ITEMS = 700
"""Most items of one mission; ArduPilot stores about as many."""
RELATIVE, AMSL = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL
_AMSL = frozenset({dialect.MAV_FRAME_GLOBAL, dialect.MAV_FRAME_GLOBAL_INT})
ABOVE_HOME = frozenset({dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_TERRAIN = frozenset({dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT, dialect.MAV_FRAME_GLOBAL_TERRAIN_ALT_INT})
FRAMES = _AMSL | ABOVE_HOME | _TERRAIN
"""MAV_FRAMEs of places."""
SHORT = {
    "waypoint": dialect.MAV_CMD_NAV_WAYPOINT,
    "takeoff": dialect.MAV_CMD_NAV_TAKEOFF,
    "land": dialect.MAV_CMD_NAV_LAND,
    "rtl": dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH,
    "loiter": dialect.MAV_CMD_NAV_LOITER_UNLIM,
    "loiter_time": dialect.MAV_CMD_NAV_LOITER_TIME,
    "spline": dialect.MAV_CMD_NAV_SPLINE_WAYPOINT,
}
"""Short names of commands in a mission; every other has its MAVLink name or number."""
LAST_NAV = dialect.MAV_CMD_NAV_LAST
"""Commands up to this one are flown; those above are carried out on the way."""
FORMS = "[Lat, Lon, Alt] or [Command, Lat, Lon, Alt, P1, P2, P3, P4]"
NAMES = {"x_lat": "latitude", "y_long": "longitude", "z_alt": "altitude"}
"""Other names of an item's fields: those of mavros' Waypoint."""
FIELDS = ("command", "latitude", "longitude", "altitude", "frame", "param1", "param2", "param3", "param4")
"""Fields of an item, for manifests that declare items with `each`."""
NOT_NEEDED = frozenset({"is_current", "autocontinue"})


@dataclass(frozen=True, slots=True)
class Item:
    """One item: degrees as 1e-7, metres in `frame`."""

    command: int = dialect.MAV_CMD_NAV_WAYPOINT
    frame: int = RELATIVE
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    x: int = 0
    y: int = 0
    z: float = 0.0
    autocontinue: int = 1

    @property
    def name(self) -> str:
        """Such as `waypoint`, or the command's MAVLink name."""
        for short, number in SHORT.items():
            if number == self.command:
                return short
        entry = dialect.enums["MAV_CMD"].get(self.command)
        return entry.name if entry else str(self.command)

    @property
    def flown(self) -> bool:
        """Whether the vehicle flies it, rather than carry it out on the way."""
        return self.command <= int(LAST_NAV)

    @property
    def ends_on_ground(self) -> bool:
        """Whether the motors stop at its end."""
        return self.command in (dialect.MAV_CMD_NAV_LAND, dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH)

    @property
    def above_terrain(self) -> bool:
        """Whether its altitude counts from the ground below."""
        return self.frame in _TERRAIN

    @property
    def placed(self) -> bool:
        """Whether it has a position; 0/0 means here."""
        return bool(self.flown and (self.x or self.y))

    @property
    def place(self) -> Place:
        """Degrees, and metres in the item's frame."""
        return Place(self.x / 1e7, self.y / 1e7, self.z)

    def outside(self, too_high: Callable[[float], str], too_far: Callable[[Place], str], home_amsl: float) -> str:
        """Return which limit it breaks; `home_amsl` is the altitude of home in metres."""
        if not self.flown or self.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return ""
        above = self.z - home_amsl if self.frame in _AMSL else self.z
        return too_high(above) or (too_far(self.place) if self.placed else "")

    def same(self, other: Item) -> bool:
        """Whether a vehicle that stores the one holds the other: it keeps places to 1e-7 deg and heights to cm."""
        if self.command != other.command:
            return False
        if self.command == dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH:
            return True
        return abs(self.x - other.x) <= 1 and abs(self.y - other.y) <= 1 and abs(self.z - other.z) <= 0.02


def read_items(value: Value, frame: int) -> tuple[Item, ...]:
    """Read the items of a mission without home. `frame`: MAV_FRAME of items that name none.

    Raises ValueError for the first that is wrong.
    """
    if not isinstance(value, list) or not value:
        raise ValueError(f"a mission is a list of items, each {FORMS}")
    if len(value) > MAX_ITEMS:
        raise ValueError(f"a mission has {MAX_ITEMS} items at most, got {len(value)}")
    items = []
    for index, entry in enumerate(value, 1):
        try:
            items.append(_read(entry, frame))
        except ValueError as error:
            raise ValueError(f"item {index} of the mission: {error}") from None
    return tuple(items)


def _read(entry: object, frame: int) -> Item:
    if isinstance(entry, Mapping):
        return _named(entry, frame)
    if not isinstance(entry, list | tuple) or not entry:
        raise ValueError(f"expected {FORMS}, got {entry!r}")
    command: object = "waypoint"
    place = entry
    if isinstance(entry[0], str):
        command, place = entry[0], entry[1:]
    elif len(entry) != 3:
        raise ValueError(f"expected {FORMS}, got {entry!r}")
    if len(place) > 7:
        raise ValueError(f"expected {FORMS}, got {entry!r}")
    latitude, longitude, altitude, one, two, three, four = [*map(_number, place), *(0.0,) * (7 - len(place))]
    return _item(_command(command), frame, (one, two, three, four), latitude, longitude, altitude)


def _named(entry: Mapping[str, object], frame: int) -> Item:
    given = {NAMES.get(name, name): value for name, value in entry.items() if name not in NOT_NEEDED}
    for name in given:
        if name not in FIELDS:
            raise ValueError(f"no field `{name}`; there is {', '.join(FIELDS)}")
    one, two, three, four, latitude, longitude, altitude = (
        _number(given.get(name, 0.0))
        for name in ("param1", "param2", "param3", "param4", "latitude", "longitude", "altitude")
    )
    own_frame = int(_number(given.get("frame", frame)))
    command = _command(given.get("command", "waypoint"))
    return _item(command, own_frame, (one, two, three, four), latitude, longitude, altitude)


def _item(
    command: int,
    frame: int,
    parameters: tuple[float, float, float, float],
    latitude: float,
    longitude: float,
    altitude: float,
) -> Item:
    if frame not in FRAMES and command <= LAST_NAV:
        raise ValueError(f"frame {frame} is neither above home, above mean sea level nor above terrain")
    if not 0 <= command <= 65535:
        raise ValueError(f"no command {command}")
    if abs(latitude) > 90 or abs(longitude) > 180:
        raise ValueError(f"no place on earth: latitude {latitude:g}, longitude {longitude:g}")
    return Item(command, frame, parameters, round(latitude * 1e7), round(longitude * 1e7), altitude)


def _command(value: object) -> int:
    if isinstance(value, int | float) and not isinstance(value, bool) and float(value).is_integer():
        return int(value)
    name = str(value).strip()
    if name.lower() in SHORT:
        return int(SHORT[name.lower()])
    number = getattr(dialect, name, None) if name.startswith("MAV_CMD_") else None
    if isinstance(number, int):
        return number
    raise ValueError(f"no command {value!r}; there is {', '.join(SHORT)}, and MAVLink's MAV_CMD_...")


def _number(value: object) -> float:
    if isinstance(value, int | float) and math.isfinite(value) and abs(value) < 1e9:
        return float(value)
    raise ValueError(f"expected a number, got {value!r}")


def item_of(message: dialect.MAVLink_message) -> Item:
    """Read MISSION_ITEM_INT, or MISSION_ITEM with its degrees."""
    scale = 1e7 if message.get_type() == "MISSION_ITEM" else 1
    parameters = (message.param1, message.param2, message.param3, message.param4)
    x, y = round(message.x * scale), round(message.y * scale)
    return Item(message.command, message.frame, parameters, x, y, message.z, message.autocontinue)
