"""From an action's entry in the manifest and its arguments to what the driver sends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Value
from bridged.drivers.mavlink.actions.context import Call, LocalTarget, Triple
from bridged.drivers.mavlink.actions.setpoints import RC_CHANNELS, RC_IGNORE, RC_IGNORE_HIGH
from bridged.drivers.mavlink.manifest.capabilities import (
    CHANNELS,
    COMMAND_FIELDS,
    COMMAND_FRAMES,
    GLOBAL_FRAMES,
    GLOBAL_TARGET,
    LOCAL_FRAMES,
)
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable
from bridged.drivers.mavlink.vehicle.state import Place
from schemas.manifest.loader import ActionEntry, FieldValue

FLOAT32_MAX = 3.4e38


def call_of(entry: ActionEntry, arguments: Mapping[str, Value], modes: ModeTable) -> Call:
    """Fill the arguments into an action. Raises ValueError for one that the driver cannot use, in words."""
    call = Call(retry=entry.retry, tolerance=entry.tolerance)
    if entry.call == "command":
        return _command(call, entry, _raw(entry, arguments), modes)
    if entry.call:
        frame = GLOBAL_FRAMES[entry.frame or "relative"] if entry.frame in (None, *GLOBAL_FRAMES) else call.frame
        return replace(call, arguments=_given(entry, arguments), frame=frame)
    if entry.message == CHANNELS:
        return replace(call, channels=_channels(_raw(entry, arguments)))
    values = {field: _value(value, arguments, modes) for field, value in entry.fields.items()}
    if entry.message == GLOBAL_TARGET:
        place = Place(values["lat_int"] / 1e7, values["lon_int"] / 1e7, values["alt"])
        frame = GLOBAL_FRAMES[entry.frame or "relative"]
        return replace(call, target=_on_earth(place), frame=frame, yaw=values.get("yaw"))
    if entry.message:
        return replace(call, local=_local(entry, values))
    return _command(call, entry, values | {"command": float(getattr(dialect, entry.command))}, modes)


def _command(call: Call, entry: ActionEntry, values: Mapping[str, object], modes: ModeTable) -> Call:
    """A command of the manifest, or one that an argument names."""
    said = values["command"]
    number = getattr(dialect, said, None) if isinstance(said, str) and said.startswith("MAV_CMD_") else said
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number <= 65535:
        raise ValueError(f"MAVLink has no command {said!r}")
    one, two, three, four, five, six, seven = (_number(values.get(field, 0.0)) for field in COMMAND_FIELDS)
    call = replace(call, number=int(number), parameters=(one, two, three, four, five, six, seven))
    if entry.frame is None:
        if call.number == dialect.MAV_CMD_DO_REPOSITION:
            raise ValueError("MAV_CMD_DO_REPOSITION needs the `frame` of its altitude, relative or amsl")
        return call
    place = Place(five, six, seven)
    return replace(call, by_int=True, target=_on_earth(place), frame=COMMAND_FRAMES[entry.frame])


def _local(entry: ActionEntry, values: Mapping[str, float]) -> LocalTarget:
    position = velocity = None
    if entry.confirm == "velocity":
        velocity = _triple(values, "vx", "vy", "vz")
    else:
        position = _triple(values, "x", "y", "z")
    frame = LOCAL_FRAMES[entry.frame or "local"]
    return LocalTarget(frame, position, velocity, values.get("yaw"), values.get("yaw_rate"))


def _triple(values: Mapping[str, float], *names: str) -> Triple:
    one, two, three = (values.get(name, 0.0) for name in names)
    return one, two, three


def _channels(values: Mapping[str, object]) -> tuple[int, ...]:
    """Channels by their fields, or all of them as a list; those that are not said stay as they are."""
    listed = values.get("channels", [])
    if not isinstance(listed, list) or len(listed) > RC_CHANNELS:
        raise ValueError(f"expected a list of {RC_CHANNELS} channels at most, got {listed!r}")
    said: dict[int, object] = dict(enumerate(listed, 1))
    said |= {int(name[4:-4]): value for name, value in values.items() if name != "channels"}
    top = max(said, default=0)
    if not top:
        raise ValueError("no channel is given")
    channels = []
    for index in range(1, top + 1):
        value = _number(said.get(index, RC_IGNORE if index <= 8 else RC_IGNORE_HIGH))
        if not (value.is_integer() and 0 <= value <= RC_IGNORE):
            raise ValueError(f"channel {index}: expected whole microseconds, 0 to release or 65535 to ignore it")
        channels.append(int(value))
    return tuple(channels)


def _given(entry: ActionEntry, arguments: Mapping[str, Value]) -> dict[str, Value]:
    """What a call is given: by its fields, or by the parameters' own names if the entry has none."""
    return _raw(entry, arguments) if entry.fields else dict(arguments)


def _raw(entry: ActionEntry, arguments: Mapping[str, Value]) -> dict[str, Value]:
    """The fields as they are, numbers converted; texts and lists go through."""
    if not entry.fields:
        return dict(arguments)
    return {field: _filled(said, arguments) for field, said in entry.fields.items()}


def _filled(said: Value | FieldValue, arguments: Mapping[str, Value]) -> Value:
    spec = said if isinstance(said, FieldValue) else FieldValue(param=said) if isinstance(said, str) else None
    if spec is None:
        return said  # type: ignore[return-value]
    value = arguments[spec.param] if spec.value is None else spec.value
    if isinstance(value, int | float) and not isinstance(value, bool) and (spec.scale, spec.offset) != (1.0, 0.0):
        return float(value) * spec.scale + spec.offset
    return value


def _value(said: Value | FieldValue, arguments: Mapping[str, Value], modes: ModeTable) -> float:
    spec = said if isinstance(said, FieldValue) else FieldValue(param=said) if isinstance(said, str) else None
    if spec is None:
        return _number(said)
    value = arguments[spec.param] if spec.value is None else spec.value
    if spec.table == "modes" and isinstance(value, str | int):
        return float(modes.number(value))
    return _number(_number(value) * spec.scale + spec.offset)


def _number(value: object) -> float:
    if isinstance(value, bool | int | float) and abs(value) <= FLOAT32_MAX:
        return float(value)
    raise ValueError(f"expected a number that fits into 32 bits, got {value!r}")


def _on_earth(place: Place) -> Place:
    if not (abs(place.latitude) <= 90 and abs(place.longitude) <= 180 and math.isfinite(place.altitude)):
        raise ValueError(f"no place on earth: latitude {place.latitude:g}, longitude {place.longitude:g}")
    return place
