"""Readings of the link, and those that mean the same whichever autopilot flies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import OnReading, Reading
from schemas.wire.terms import Atom

Make = Callable[[dialect.MAVLink_message], Mapping[str, object]]

BATTERY, RC_INPUT, SERVO_OUTPUTS, WIND_ESTIMATE = "BATTERY", "RC_INPUT", "SERVO_OUTPUTS", "WIND_ESTIMATE"

OUTPUTS = 16
"""Outputs in one SERVO_OUTPUT_RAW."""
FIELDS: Mapping[str, tuple[str, ...]] = {
    BATTERY: ("id", "voltage", "remaining"),
    RC_INPUT: ("channels", "rssi"),
    SERVO_OUTPUTS: tuple(f"output{number}" for number in range(1, 2 * OUTPUTS + 1)),
    WIND_ESTIMATE: ("direction", "speed"),
}
"""Sources and their fields."""


def fields(message: dialect.MAVLink_message) -> Mapping[str, object]:
    """Return the fields of a message, texts as strings; a place at 0/0 is one that the vehicle does not know."""
    found = vars(message)
    unknown = found.get("lat") == 0 == found.get("lon")
    return {**found, "lat": math.nan, "lon": math.nan} if unknown else found


NO_OUTPUT = 65535
"""A pulse in SERVO_OUTPUT_RAW of an output that is of another port."""
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


class _ServoOutputs:
    """Pulses in microseconds of outputs 1 to 32, 0 = none: a message has those of one port."""

    def __init__(self) -> None:
        self._pulses = dict.fromkeys(FIELDS[SERVO_OUTPUTS], 0)

    def __call__(self, message: dialect.MAVLink_message) -> Mapping[str, object]:
        for output in range(1, OUTPUTS + 1 if message.port < 2 else 1):
            pulse = getattr(message, f"servo{output}_raw")
            if pulse != NO_OUTPUT:
                self._pulses[f"output{OUTPUTS * message.port + output}"] = pulse
        return dict(self._pulses)


def _wind(message: dialect.MAVLink_message) -> Mapping[str, object]:
    return {"direction": message.direction % 360.0, "speed": message.speed}


def _wind_vector(message: dialect.MAVLink_message) -> Mapping[str, object]:
    """WIND_COV names where the air goes, north and east."""
    north, east = message.wind_x, message.wind_y
    return {"direction": math.degrees(math.atan2(-east, -north)) % 360.0, "speed": math.hypot(north, east)}


DERIVED: Mapping[str, tuple[str, Make | type[_ServoOutputs]]] = {
    "BATTERY_STATUS": (BATTERY, _battery),
    "RC_CHANNELS": (RC_INPUT, _rc_input),
    "SERVO_OUTPUT_RAW": (SERVO_OUTPUTS, _ServoOutputs),
    "WIND": (WIND_ESTIMATE, _wind),
    "WIND_COV": (WIND_ESTIMATE, _wind_vector),
}
"""By message: the source of the reading that is made of it, and how; a class remembers earlier messages. Directions are
degrees from north, clockwise, from which the wind blows; speeds are m/s over ground."""


def derived(sources: Iterable[str]) -> dict[str, tuple[str, Make]]:
    """Return the rows that make readings of these sources, of one vehicle."""
    wanted = set(sources)
    return {
        message: (source, make() if isinstance(make, type) else make)
        for message, (source, make) in DERIVED.items()
        if source in wanted
    }


_ATOMS = {True: Atom("up"), False: Atom("down")}


class LinkState:
    """The percept of the link: `up` while the vehicle is heard over a transport that carries, `down` otherwise.

    Each change is reported once. A vehicle that was not heard yet is neither up nor down until it has been silent for
    the time of a link loss: a program need not distinguish the start of a flight from a loss. Times are in mission s.
    """

    def __init__(self, on_reading: OnReading) -> None:
        self._on_reading = on_reading
        self._reported: bool | None = None
        self._begun = math.inf
        self._carries = True
        self._carries_since = -math.inf

    def carry(self, up: bool, now: float) -> None:
        """Take in that the transport (a socket, a device) came up or went down at `now` (mission seconds)."""
        if up and not self._carries:
            self._carries_since = now
        self._carries = up

    def look(self, connected: bool, heard_at: float, now: float, patience: float) -> None:
        """Report a change of `connected`; `heard_at`, the last packet, and `now` are in mission seconds.

        `patience`: mission seconds of silence that are a link loss. After the transport was down the link is up when
        the vehicle is heard again, not before.
        """
        self._begun = min(self._begun, now)
        up = self._carries and connected and heard_at >= self._carries_since
        if up is self._reported or (not up and self._reported is None and now - self._begun <= patience):
            return
        self._reported = up
        self._on_reading(Reading("LINK", {"state": _ATOMS[up]}))
