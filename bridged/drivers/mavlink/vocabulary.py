"""What a manifest may say to the MAVLink driver, and how it is read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.flight import Call
from bridged.drivers.mavlink.modes import MODE_TABLES, ModeTable
from bridged.drivers.mavlink.procedures import PROCEDURES
from bridged.drivers.mavlink.vehicle import Place
from bridged.drivers.robot import Value
from schemas.findings import Finding
from schemas.manifest import ActionEntry, FieldValue, Manifest, PerceptEntry

COMMAND_FIELDS = tuple(f"param{index}" for index in range(1, 8))
TARGET = "SET_POSITION_TARGET_GLOBAL_INT"
TARGET_FIELDS = ("lat_int", "lon_int", "alt")
OWN_FIELDS = {"HEARTBEAT": ("mode", "connected", "armed"), "OVERRIDE": ("mode",), "LINK": ("state",)}
"""Sources that the driver reads itself: the mode's name, a mode set by others, and the link as the atom up or down."""
TABLES = ("modes",)
BY_MESSAGE = frozenset({"target", "arrival"})
"""Confirmations of actions that send a position target; the others confirm commands."""
FLOAT32_MAX = 3.4e38
FRAMES = {
    "relative": dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
    "amsl": dialect.MAV_FRAME_GLOBAL_INT,
}


def check_manifest(manifest: Manifest) -> list[Finding]:
    """Say what the driver does not know in a manifest: vehicle, sources, fields, commands, confirmations."""
    return list(_problems(manifest))


def call_of(entry: ActionEntry, arguments: Mapping[str, Value], modes: ModeTable) -> Call:
    """Fill the arguments into an action. Raises ValueError for one that the driver cannot use, in words."""
    values = {field: _value(value, arguments, modes) for field, value in entry.fields.items()}
    if entry.message:
        latitude, longitude, altitude = (values[field] for field in TARGET_FIELDS)
        if abs(latitude) > 90e7 or abs(longitude) > 180e7:
            raise ValueError(f"no place on earth: latitude {latitude / 1e7:g}, longitude {longitude / 1e7:g}")
        return Call(
            target=Place(latitude / 1e7, longitude / 1e7, altitude),
            frame=FRAMES[entry.frame or "relative"],
            retry=entry.retry,
            tolerance=entry.tolerance,
        )
    parameters = tuple(values.get(field, 0.0) for field in COMMAND_FIELDS)
    one, two, three, four, five, six, seven = parameters
    number = getattr(dialect, entry.command)
    return Call(number, (one, two, three, four, five, six, seven), entry.retry, tolerance=entry.tolerance)


def _value(said: Value | FieldValue, arguments: Mapping[str, Value], modes: ModeTable) -> float:
    spec = said if isinstance(said, FieldValue) else FieldValue(param=said) if isinstance(said, str) else None
    if spec is None:
        return _number(said)
    value = arguments[spec.param]
    if spec.table == "modes" and isinstance(value, str | int):
        return float(modes.number(value))
    return _number(_number(value) * spec.scale)


def _number(value: object) -> float:
    if isinstance(value, bool | int | float) and abs(value) <= FLOAT32_MAX:
        return float(value)
    raise ValueError(f"expected a number that fits into 32 bits, got {value!r}")


def _problems(manifest: Manifest) -> Iterator[Finding]:
    if manifest.robot.vehicle not in MODE_TABLES:
        known = ", ".join(MODE_TABLES)
        yield manifest.finding(
            f"robot.vehicle: the mavlink driver has no `{manifest.robot.vehicle}`, it has {known}", "robot", "vehicle"
        )
    for name, percept in manifest.percepts.items():
        for problem, field in _percept_problems(percept):
            yield manifest.finding(f"percepts.{name}.{field}: {problem}", "percepts", name, field)
    for name, action in manifest.actions.items():
        for problem, field in _action_problems(action):
            yield manifest.finding(f"actions.{name}.{field}: {problem}", "actions", name, field)


def _percept_problems(entry: PerceptEntry) -> Iterator[tuple[str, str]]:
    own = OWN_FIELDS.get(entry.source)
    number = getattr(dialect, f"MAVLINK_MSG_ID_{entry.source}", None)
    if own is None and number is None:
        yield f"MAVLink has no message `{entry.source}`", "source"
        return
    known = own or dialect.mavlink_map[number].fieldnames
    for field in entry.fields():
        head, _, rest = field.field.partition(".")
        if head not in known:
            yield f"{entry.source} has no field `{head}`, it has {', '.join(known)}", "args"
        elif rest and not _is_index(entry.source, number, head, rest, own is not None):
            yield f"{entry.source}.{head} has no element `{rest}`", "args"


def _is_index(source: str, number: int | None, field: str, rest: str, own: bool) -> bool:
    if own or number is None or not rest.isdigit():
        return False
    message = dialect.mavlink_map[number]
    at = message.ordered_fieldnames.index(field)
    return bool(int(rest) < message.array_lengths[at])


def _action_problems(entry: ActionEntry) -> Iterator[tuple[str, str]]:
    if entry.confirm not in PROCEDURES:
        yield f"expected one of {', '.join(PROCEDURES)}, got `{entry.confirm}`", "confirm"
    elif entry.message and entry.confirm not in BY_MESSAGE:
        yield f"`{entry.confirm}` confirms a command, not a message", "confirm"
    elif entry.command and entry.confirm in BY_MESSAGE:
        yield f"`{entry.confirm}` confirms the message {TARGET}, not a command", "confirm"
    if entry.message:
        if entry.message != TARGET:
            yield f"the driver sends {TARGET} only, got `{entry.message}`", "message"
        if entry.frame is None:
            yield "a position target needs `frame`, relative (to home) or amsl", "message"
        yield from _field_problems(entry, TARGET_FIELDS)
        for field in TARGET_FIELDS:
            if field not in entry.fields:
                yield f"`{field}` is missing", "fields"
    else:
        known = getattr(dialect, entry.command, None)
        if not entry.command.startswith("MAV_CMD_") or not isinstance(known, int):
            yield f"MAVLink has no command `{entry.command}`", "command"
        yield from _field_problems(entry, COMMAND_FIELDS)


def _field_problems(entry: ActionEntry, known: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    for field, value in entry.fields.items():
        if field not in known:
            yield f"no field `{field}`, there is {', '.join(known)}", "fields"
        if isinstance(value, FieldValue) and value.table and value.table not in TABLES:
            yield f"no table `{value.table}`, there is {', '.join(TABLES)}", "fields"
        if isinstance(value, float) and not math.isfinite(value):
            yield f"`{field}` is not a finite number", "fields"
