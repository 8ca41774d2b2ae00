"""From an action's entry in the manifest to a procedure, and to the action with its arguments filled in.

Tables say what the driver offers a manifest: confirmations of commands, messages, and calls of its own; each row says
which fields there are, how it is carried out, and which figures it reports as feedback."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Value
from bridged.drivers.argument_check import fields_of, filled
from bridged.drivers.mavlink.actions import (
    camera,
    fence_upload,
    flight,
    gimbal,
    log_download,
    mission_actions,
    mission_execution,
    outputs,
    parameters,
    setpoints,
)
from bridged.drivers.mavlink.actions.context import BoundAction, LocalTarget, Procedure, Triple
from bridged.drivers.mavlink.actions.setpoints import RC_CHANNELS, RC_IGNORE, RC_IGNORE_HIGH
from bridged.drivers.mavlink.vehicle.flight_modes import ModeTable
from bridged.drivers.mavlink.vehicle.state import Place
from schemas.manifest.loader import ActionEntry, FieldValue

COMMAND_FIELDS = tuple(f"param{index}" for index in range(1, 8))
GLOBAL_TARGET, LOCAL_TARGET = "SET_POSITION_TARGET_GLOBAL_INT", "SET_POSITION_TARGET_LOCAL_NED"
CHANNELS = "RC_CHANNELS_OVERRIDE"
REPOSITION = "MAV_CMD_DO_REPOSITION"
GLOBAL_FRAMES: Mapping[str, int] = MappingProxyType(
    {"relative": dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, "amsl": dialect.MAV_FRAME_GLOBAL_INT}
)
COMMAND_FRAMES: Mapping[str, int] = MappingProxyType(
    {"relative": dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, "amsl": dialect.MAV_FRAME_GLOBAL}
)
LOCAL_FRAMES: Mapping[str, int] = MappingProxyType({"local": setpoints.LOCAL, "body": setpoints.BODY})

_CLIMB = ("altitude", "to_go")
_WAY = ("distance", "altitude", "speed")
_DOWN = ("altitude", "distance")
_ITEMS = ("item", "items")


@dataclass(frozen=True)
class MessageForm:
    """A message that the driver sends: its fields, its frames, and what confirms it."""

    fields: tuple[str, ...]
    frames: Mapping[str, int]
    confirm: Mapping[str, Procedure]
    needed: Mapping[str, tuple[str, ...]]
    """By confirmation: fields without which it proves nothing."""


@dataclass(frozen=True)
class CallForm:
    """A call by a name of the driver's own, and what it is given."""

    fields: tuple[str, ...]
    procedure: Procedure
    needed: tuple[str, ...] = ()
    confirm: str = ""
    """The required `confirm` of its manifest entry; empty = it confirms itself."""
    frames: Mapping[str, int] = field(default_factory=dict)


COMMANDS: Mapping[str, Procedure] = MappingProxyType({
    "mode": Procedure(mission_execution.enter_mode, sets_mode=True, takes_control=True),
    "armed": Procedure(flight.arm, ("cause",)),
    "altitude": Procedure(flight.take_off, _CLIMB),
    "target": Procedure(flight.reposition),
    "arrival": Procedure(flight.reposition_and_arrive, _WAY),
    "orbit": Procedure(flight.orbit),
    "landed": Procedure(flight.land, _DOWN),
    "home": Procedure(flight.return_home, _DOWN),
    "at_home": Procedure(flight.return_above, ("distance", "speed")),
    "servo": Procedure(outputs.move_servo),
    "gripper": Procedure(outputs.grip),
    "relay": Procedure(outputs.switch_relay),
    "winch": Procedure(outputs.move_winch, ("line", "to_go")),
    "picture": Procedure(camera.take_picture),
    "camera": Procedure(camera.set_camera),
    "gimbal": Procedure(gimbal.command_gimbal, ("pitch", "yaw")),
    "fence": Procedure(outputs.fence),
    "ack": Procedure(outputs.acknowledge),
})  # fmt: skip
"""Confirmations of commands."""


def _names(commands: Iterable[int]) -> tuple[str, ...]:
    return tuple(dialect.enums["MAV_CMD"][number].name for number in commands)


COMMANDS_OF: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "mode": ("MAV_CMD_DO_SET_MODE",),
    "armed": ("MAV_CMD_COMPONENT_ARM_DISARM",),
    "altitude": ("MAV_CMD_NAV_TAKEOFF",),
    "target": (REPOSITION,),
    "arrival": (REPOSITION,),
    "orbit": ("MAV_CMD_DO_ORBIT",),
    "servo": ("MAV_CMD_DO_SET_SERVO",),
    "gripper": ("MAV_CMD_DO_GRIPPER",),
    "relay": ("MAV_CMD_DO_SET_RELAY",),
    "winch": ("MAV_CMD_DO_WINCH",),
    "picture": ("MAV_CMD_IMAGE_START_CAPTURE",),
    "camera": _names(camera.PROOFS),
    "gimbal": _names(gimbal.STEPS),
    "fence": ("MAV_CMD_DO_FENCE_ENABLE",),
})  # fmt: skip
"""Confirmations that read the parameters of one command, and are of no other."""

MESSAGES: Mapping[str, MessageForm] = MappingProxyType({
    GLOBAL_TARGET: MessageForm(
        ("lat_int", "lon_int", "alt", "yaw"),
        GLOBAL_FRAMES,
        {"target": Procedure(flight.send_target), "arrival": Procedure(flight.go_to, _WAY)},
        dict.fromkeys(("target", "arrival"), ("lat_int", "lon_int", "alt")),
    ),
    LOCAL_TARGET: MessageForm(
        ("x", "y", "z", "vx", "vy", "vz", "yaw", "yaw_rate"),
        LOCAL_FRAMES,
        {
            "target": Procedure(setpoints.send_local_place),
            "arrival": Procedure(setpoints.go_to_local, _WAY),
            "velocity": Procedure(setpoints.send_velocity),
        },
        {"target": ("x", "y", "z"), "arrival": ("x", "y", "z"), "velocity": ("vx", "vy")},
    ),
    CHANNELS: MessageForm(
        ("channels", *(f"chan{index}_raw" for index in range(1, setpoints.RC_CHANNELS + 1))),
        {},
        {"rc": Procedure(setpoints.override_channels), "sent": Procedure(setpoints.send_channels)},
        {},
    ),
})  # fmt: skip
"""Messages that are sent instead of a command: nothing acknowledges them."""

CALLS: Mapping[str, CallForm] = MappingProxyType({
    "mission_upload": CallForm(
        ("items", "home_first"), Procedure(mission_actions.upload_mission, _ITEMS), ("items",), frames=GLOBAL_FRAMES
    ),
    "plan_upload": CallForm(("file",), Procedure(fence_upload.upload_plan, _ITEMS), ("file",)),
    "mission_download": CallForm((), Procedure(mission_actions.download_mission, _ITEMS)),
    "mission_start": CallForm(
        (),
        Procedure(
            mission_execution.start_mission, ("item", "items", "reached", "altitude", "distance"), judges_mode=True
        ),
    ),
    "fence_upload": CallForm(("points",), Procedure(fence_upload.upload_fence, _ITEMS), ("points",)),
    "mission_clear": CallForm((), Procedure(mission_actions.clear_mission)),
    "mission_set_current": CallForm(("seq",), Procedure(mission_actions.set_current), ("seq",)),
    "param_pull": CallForm((), Procedure(parameters.pull_parameters, ("params", "of"))),
    "param_get": CallForm(("name",), Procedure(parameters.get_parameter), ("name",)),
    "param_set": CallForm(("name", "value"), Procedure(parameters.set_parameter), ("name", "value")),
    "log_download": CallForm(("log",), Procedure(log_download.download_log, ("bytes", "of"))),
    "takeoff_by_mode": CallForm(
        ("altitude",), Procedure(flight.take_off_by_mode, _CLIMB), ("altitude",)
    ),
    "command": CallForm(
        ("command", *COMMAND_FIELDS), Procedure(outputs.acknowledge), ("command",), confirm="ack", frames=COMMAND_FRAMES
    ),
})  # fmt: skip
"""Calls of the driver's own."""

KNOWN_BETTER: Mapping[int, str] = MappingProxyType({
    dialect.MAV_CMD_DO_SET_MODE: "mode",
    dialect.MAV_CMD_COMPONENT_ARM_DISARM: "armed",
    dialect.MAV_CMD_NAV_TAKEOFF: "altitude",
    dialect.MAV_CMD_NAV_LAND: "landed",
    dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: "home",
    dialect.MAV_CMD_DO_REPOSITION: "target",
    dialect.MAV_CMD_DO_ORBIT: "orbit",
    dialect.MAV_CMD_DO_SET_SERVO: "servo",
    dialect.MAV_CMD_DO_FENCE_ENABLE: "fence",
})  # fmt: skip
"""Commands that the call `command` does not leave at the acknowledgement: what proves them is known; limits hold."""


def procedure_of(entry: ActionEntry, number: int) -> Procedure:
    """Return how an entry that nothing is wrong with is carried out; `number` (MAV_CMD) is the command it came to."""
    if entry.call:
        if entry.call == "command" and number in KNOWN_BETTER:
            return COMMANDS[KNOWN_BETTER[number]]
        return CALLS[entry.call].procedure
    return MESSAGES[entry.message].confirm[entry.confirm] if entry.message else COMMANDS[entry.confirm]


FLOAT32_MAX = 3.4e38


def bind_action(entry: ActionEntry, arguments: Mapping[str, Value], modes: ModeTable) -> BoundAction:
    """Fill the arguments into an action. Raises ValueError for one that the driver cannot use."""
    action = BoundAction(retry=entry.retry, tolerance=entry.tolerance)
    if entry.call or entry.message == CHANNELS:
        given = {name: filled(f"field `{name}`", declared, arguments) for name, declared in fields_of(entry).items()}
        if entry.call == "command":
            return _command(action, entry, given, modes)
        if entry.message:
            return replace(action, channels=_channels(given))
        frame = GLOBAL_FRAMES[entry.frame or "relative"] if entry.frame in (None, *GLOBAL_FRAMES) else action.frame
        return replace(action, arguments=given, frame=frame)
    values = {
        field: _value(FieldValue.written_out(declared), arguments, modes) for field, declared in entry.fields.items()
    }
    if entry.message == GLOBAL_TARGET:
        place = Place(values["lat_int"] / 1e7, values["lon_int"] / 1e7, values["alt"])
        frame = GLOBAL_FRAMES[entry.frame or "relative"]
        return replace(action, target=_on_earth(place), frame=frame, yaw=values.get("yaw"))
    if entry.message:
        by_velocity = entry.confirm == "velocity"
        local = LocalTarget(
            LOCAL_FRAMES[entry.frame or "local"],
            None if by_velocity else _triple(values, "x", "y", "z"),
            _triple(values, "vx", "vy", "vz") if by_velocity else None,
            values.get("yaw"),
            values.get("yaw_rate"),
        )
        return replace(action, local=local)
    return _command(action, entry, values | {"command": float(getattr(dialect, entry.command))}, modes)


def _command(action: BoundAction, entry: ActionEntry, values: Mapping[str, object], modes: ModeTable) -> BoundAction:
    """A command of the manifest, or one that an argument names."""
    command = values["command"]
    number = getattr(dialect, command, None) if isinstance(command, str) and command.startswith("MAV_CMD_") else command
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number <= 65535:
        raise ValueError(f"MAVLink has no command {command!r}")
    one, two, three, four, five, six, seven = (_number(values.get(field, 0.0)) for field in COMMAND_FIELDS)
    if int(number) == dialect.MAV_CMD_DO_SET_MODE:
        mode = modes.requested(two, three)
        return replace(
            action, number=int(number), parameters=(one, *modes.request(mode), four, five, six, seven), mode=mode
        )
    action = replace(action, number=int(number), parameters=(one, two, three, four, five, six, seven))
    if entry.frame is None:
        if action.number == dialect.MAV_CMD_DO_REPOSITION:
            raise ValueError("MAV_CMD_DO_REPOSITION needs the `frame` of its altitude, relative or amsl")
        return action
    place = Place(five, six, seven)
    return replace(action, by_int=True, target=_on_earth(place), frame=COMMAND_FRAMES[entry.frame])


def _triple(values: Mapping[str, float], *names: str) -> Triple:
    one, two, three = (values.get(name, 0.0) for name in names)
    return one, two, three


def _channels(values: Mapping[str, object]) -> tuple[int, ...]:
    """Return channels by their fields, or all of them as a list; those not given stay as they are."""
    listed = values.get("channels", [])
    if not isinstance(listed, list) or len(listed) > RC_CHANNELS:
        raise ValueError(f"expected a list of {RC_CHANNELS} channels at most, got {listed!r}")
    pulses: dict[int, object] = dict(enumerate(listed, 1))
    pulses |= {int(name[4:-4]): value for name, value in values.items() if name != "channels"}
    top = max(pulses, default=0)
    if not top:
        raise ValueError("no channel is given")
    channels = []
    for index in range(1, top + 1):
        value = _number(pulses.get(index, RC_IGNORE if index <= 8 else RC_IGNORE_HIGH))
        if not (value.is_integer() and 0 <= value <= RC_IGNORE):
            raise ValueError(f"channel {index}: expected whole microseconds, 0 to release or 65535 to ignore it")
        channels.append(int(value))
    return tuple(channels)


def _value(spec: FieldValue, arguments: Mapping[str, Value], modes: ModeTable) -> float:
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


WAYS_DOWN = frozenset({"landed", "home", "at_home", "mode", "armed"})
"""Confirmations of actions that can bring a vehicle down, or end its flight."""


def may_lead_down(entry: ActionEntry) -> bool:
    """Whether an action can bring a vehicle down that flies: landing, returning, or a mode or disarming that may."""
    return entry.confirm in WAYS_DOWN


def leads_down(entry: ActionEntry, action: BoundAction, modes: ModeTable) -> bool:
    """Whether it does so with its arguments filled in: it starts no motors and sets no mode but the safe ones."""
    match entry.confirm:
        case "mode":
            return action.mode in (modes.hold, modes.land, modes.rtl)
        case "armed":
            return action.parameters[0] == 0.0
    return may_lead_down(entry)
