"""Validation of a manifest by the MAVLink driver: every unknown name is a finding at its line."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable, Iterator, Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.action_binding import (
    CALLS,
    CHANNELS,
    COMMAND_FIELDS,
    COMMAND_FRAMES,
    COMMANDS,
    COMMANDS_OF,
    MESSAGES,
    REPOSITION,
)
from bridged.drivers.mavlink.actions.context import Procedure
from bridged.drivers.mavlink.vehicle import readings
from bridged.drivers.mavlink.vehicle.flight_modes import MODE_TABLES
from schemas.files.findings import Finding, near_miss
from schemas.manifest.loader import ActionEntry, FieldValue, Manifest, PerceptEntry

OWN_FIELDS: Mapping[str, tuple[str, ...]] = {
    "HEARTBEAT": ("mode", "connected", "armed", "guided", "manual_input", "system_status"),
    "OVERRIDE": ("mode",),
    "LINK": ("state",),
    "PARAM": ("name", "value"),
    "VEHICLE_TEXT": ("severity", "text"),
    "MISSION": (
        "seq", "command", "latitude", "longitude", "altitude", "frame", "param1", "param2", "param3", "param4", "count",
    ),
    "MISSION_LIST": ("count", "waypoints"),
    **readings.FIELDS,
}  # fmt: skip
"""Sources that the driver reads itself: the mode's name, a mode set by others, the link as the atom up or down, a
parameter that was asked for, a warning of the vehicle, and the items of the mission that was sent or read last."""
OWN_PATHS = frozenset({"MISSION_LIST"})
"""Sources of the driver's own whose fields have parts."""
TABLES = ("modes",)
WAYS = ("command", "message", "call")
_CLOSE = 0.8
"""The least similarity of a near miss (`nearest`): names of MAVLink are long, and many begin alike."""

Problem = tuple[str, str]
"""A problem, and its key."""


def check_manifest(manifest: Manifest) -> list[Finding]:
    """Yield a finding for each unknown vehicle, source, field, command, call and confirmation of a manifest."""
    return list(_problems(manifest))


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


def _percept_problems(entry: PerceptEntry) -> Iterator[Problem]:
    own = OWN_FIELDS.get(entry.source)
    number = getattr(dialect, f"MAVLINK_MSG_ID_{entry.source}", None)
    if own is None and number is None:
        hint = near_miss(entry.source, [*OWN_FIELDS, *(one.msgname for one in dialect.mavlink_map.values())], _CLOSE)
        hint = hint or f", and the driver has {_list(OWN_FIELDS)} of its own"
        yield f"MAVLink has no message `{entry.source}`{hint}", "source"
        return
    known = own or dialect.mavlink_map[number].fieldnames
    for field in entry.fields():
        head, _, rest = field.field.partition(".")
        if head not in known:
            yield f"{entry.source} has no field `{head}`, it has {', '.join(known)}", "args"
        elif entry.source in OWN_PATHS:
            continue
        elif rest and not _is_index(number, head, rest, own is not None):
            yield f"{entry.source}.{head} has no element `{rest}`", "args"
        elif field.each:
            yield f"{entry.source}.{head} holds no structures: `each` has nothing to pick", "args"


def _is_index(number: int | None, field: str, rest: str, own: bool) -> bool:
    if own or number is None or not rest.isdigit():
        return False
    message = dialect.mavlink_map[number]
    at = message.ordered_fieldnames.index(field)
    return bool(int(rest) < message.array_lengths[at])


def _action_problems(entry: ActionEntry) -> Iterator[Problem]:
    procedure: Procedure | None = None
    if entry.message:
        procedure = yield from _message_problems(entry)
    elif entry.call:
        procedure = yield from _call_problems(entry)
    elif entry.command:
        procedure = yield from _command_problems(entry)
    else:
        yield f"the mavlink driver acts by {', '.join(f'`{way}`' for way in WAYS)}", next(iter(entry.ways()), "command")
    for figure in entry.feedback or ():
        if procedure is not None and figure not in procedure.feedback:
            yield f"`{figure}` is not reported; there is {_list(procedure.feedback)}", "feedback"


def _message_problems(entry: ActionEntry) -> Generator[Problem, None, Procedure | None]:
    message = MESSAGES.get(entry.message)
    if message is None:
        yield f"the driver sends {_list(MESSAGES)}, got `{entry.message}`", "message"
        return None
    if entry.confirm not in message.confirm:
        yield f"{entry.message} is confirmed by {_list(message.confirm)}, got `{entry.confirm}`", "confirm"
    if message.frames and entry.frame is None:
        yield f"{entry.message} needs `frame`: {_list(message.frames)}", "message"
    elif entry.frame is not None and entry.frame not in message.frames:
        yield f"{entry.message} has the frames {_list(message.frames)}, got `{entry.frame}`", "frame"
    yield from _field_problems(entry, message.fields)
    for field in message.needed.get(entry.confirm, ()):
        if field not in entry.fields:
            yield f"`{field}` is missing", "fields"
    if entry.message == CHANNELS and not entry.fields:
        yield "no channel is given", "fields"
    return message.confirm.get(entry.confirm)


def _call_problems(entry: ActionEntry) -> Generator[Problem, None, Procedure | None]:
    call = CALLS.get(entry.call)
    if call is None:
        yield f"the driver has no call `{entry.call}`; it has {_list(CALLS)}", "call"
        return None
    if entry.confirm != call.confirm:
        wanted = f"`{call.confirm}`" if call.confirm else "no `confirm`: it confirms itself"
        yield f"{entry.call} takes {wanted}, got `{entry.confirm}`", "confirm"
    if entry.frame is not None and entry.frame not in call.frames:
        yield f"{entry.call} has the frames {_list(call.frames)}, got `{entry.frame}`", "frame"
    given = entry.fields or {parameter.name: parameter.name for parameter in entry.params}
    key = "fields" if entry.fields else "params"
    for field in given:
        if field not in call.fields:
            yield f"{entry.call} is given {_list(call.fields)}, got `{field}`", key
    for field in call.needed:
        if field not in given:
            yield f"{entry.call} needs `{field}`", key
    yield from _field_problems(entry, (*call.fields, *entry.fields))
    return call.procedure


def _command_problems(entry: ActionEntry) -> Generator[Problem, None, Procedure | None]:
    number = getattr(dialect, entry.command, None)
    if not entry.command.startswith("MAV_CMD_") or not isinstance(number, int):
        hint = near_miss(entry.command, [one.name for one in dialect.enums["MAV_CMD"].values()], _CLOSE)
        yield f"MAVLink has no command `{entry.command}`{hint}", "command"
    if entry.confirm not in COMMANDS:
        yield f"a command is confirmed by {_list(COMMANDS)}, got `{entry.confirm}`", "confirm"
    elif entry.command not in COMMANDS_OF.get(entry.confirm, (entry.command,)):
        yield f"`{entry.confirm}` confirms {_list(COMMANDS_OF[entry.confirm])}, not {entry.command}", "confirm"
    if entry.frame is not None and entry.frame not in COMMAND_FRAMES:
        yield f"a command has the frames {_list(COMMAND_FRAMES)}, got `{entry.frame}`", "frame"
    if entry.command == REPOSITION and entry.frame is None:
        yield f"{REPOSITION} needs `frame`: {_list(COMMAND_FRAMES)}", "command"
    yield from _field_problems(entry, COMMAND_FIELDS)
    return COMMANDS.get(entry.confirm)


def _field_problems(entry: ActionEntry, known: tuple[str, ...]) -> Iterator[Problem]:
    for field, value in entry.fields.items():
        if field not in known:
            yield f"no field `{field}`, there is {', '.join(known)}", "fields"
        if isinstance(value, FieldValue) and value.table and value.table not in TABLES:
            yield f"no table `{value.table}`, there is {', '.join(TABLES)}", "fields"
        if isinstance(value, float) and not math.isfinite(value):
            yield f"`{field}` is not a finite number", "fields"


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
