"""Readings that the driver makes of messages, so that a percept means the same whichever autopilot flies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

Make = Callable[[dialect.MAVLink_message], Mapping[str, object]]

BATTERY, RC_INPUT, WIND_ESTIMATE = "BATTERY", "RC_INPUT", "WIND_ESTIMATE"

FIELDS: Mapping[str, tuple[str, ...]] = {
    BATTERY: ("id", "voltage", "remaining"),
    RC_INPUT: ("channels", "rssi"),
    WIND_ESTIMATE: ("direction", "speed"),
}
"""Sources and their fields."""


_NO_CELL = 65535
"""Millivolts in BATTERY_STATUS of a cell that is not there, or not measured."""


def _battery(message: dialect.MAVLink_message) -> Mapping[str, object]:
    """Voltage in V over all cells, -1 = not known: autopilots name each cell, or the whole as the first one."""
    cells = [cell for cell in message.voltages if cell != _NO_CELL] + [cell for cell in message.voltages_ext if cell]
    voltage = round(sum(cells) / 1000, 3) if cells else -1.0
    return {"id": message.id, "voltage": voltage, "remaining": message.battery_remaining}


def _rc_input(message: dialect.MAVLink_message) -> Mapping[str, object]:
    """Pulses in microseconds of the channels that the receiver has; rssi 0 to 254, 255 = not known."""
    count = min(message.chancount, 18)
    channels = [getattr(message, f"chan{index}_raw") for index in range(1, count + 1)]
    return {"channels": channels, "rssi": message.rssi}


def _wind(message: dialect.MAVLink_message) -> Mapping[str, object]:
    return {"direction": message.direction % 360.0, "speed": message.speed}


def _wind_vector(message: dialect.MAVLink_message) -> Mapping[str, object]:
    """WIND_COV names where the air goes, north and east."""
    north, east = message.wind_x, message.wind_y
    return {"direction": math.degrees(math.atan2(-east, -north)) % 360.0, "speed": math.hypot(north, east)}


DERIVED: Mapping[str, tuple[str, Make]] = {
    "BATTERY_STATUS": (BATTERY, _battery),
    "RC_CHANNELS": (RC_INPUT, _rc_input),
    "WIND": (WIND_ESTIMATE, _wind),
    "WIND_COV": (WIND_ESTIMATE, _wind_vector),
}
"""By message: the source of the reading that is made of it, and how. Directions are degrees from north, clockwise, from
which the wind blows; speeds are m/s over ground."""


def derived(sources: Iterable[str]) -> dict[str, tuple[str, Make]]:
    """Return the rows that make readings of these sources."""
    wanted = set(sources)
    return {message: row for message, row in DERIVED.items() if row[0] in wanted}
