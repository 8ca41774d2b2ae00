"""What the driver offers a manifest, as tables: confirmations of commands, messages, and calls of its own.

Each row says which fields there are, how it is carried out, and which figures it tells as feedback.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions import flight, mission_actions, mission_execution, outputs, parameters, setpoints
from bridged.drivers.mavlink.actions.context import Procedure
from schemas.manifest.loader import ActionEntry

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
class Offer:
    """How an action is carried out once its fields are filled in."""

    procedure: Procedure
    feedback: tuple[str, ...] = ()
    """The figures of its progress."""
    sets_mode: bool = False
    takes_control: bool = False
    judges_mode: bool = False


@dataclass(frozen=True)
class MessageOffer:
    """A message that the driver sends: its fields, its frames, and what confirms it."""

    fields: tuple[str, ...]
    frames: Mapping[str, int]
    confirm: Mapping[str, Offer]
    needed: Mapping[str, tuple[str, ...]]
    """By confirmation: fields without which it says nothing."""


@dataclass(frozen=True)
class CallOffer:
    """A call by a name of the driver's own, and what it is given."""

    fields: tuple[str, ...]
    offer: Offer
    needed: tuple[str, ...] = ()
    confirm: str = ""
    """What its manifest entry must say as `confirm`; empty = it confirms itself."""
    frames: Mapping[str, int] = field(default_factory=dict)


COMMANDS: Mapping[str, Offer] = MappingProxyType({
    "mode": Offer(mission_execution.enter_mode, sets_mode=True, takes_control=True),
    "armed": Offer(flight.arm, ("cause",)),
    "altitude": Offer(flight.take_off, _CLIMB),
    "target": Offer(flight.reposition),
    "arrival": Offer(flight.reposition_and_arrive, _WAY),
    "landed": Offer(flight.land, _DOWN),
    "home": Offer(flight.return_home, _DOWN),
    "at_home": Offer(flight.return_above, ("distance", "speed")),
    "servo": Offer(outputs.move_servo),
    "gripper": Offer(outputs.grip),
    "fence": Offer(outputs.fence),
    "ack": Offer(outputs.acknowledge),
})  # fmt: skip
"""Confirmations of commands."""

COMMANDS_OF: Mapping[str, tuple[str, ...]] = MappingProxyType({
    "mode": ("MAV_CMD_DO_SET_MODE",),
    "armed": ("MAV_CMD_COMPONENT_ARM_DISARM",),
    "altitude": ("MAV_CMD_NAV_TAKEOFF",),
    "target": (REPOSITION,),
    "arrival": (REPOSITION,),
    "servo": ("MAV_CMD_DO_SET_SERVO",),
    "gripper": ("MAV_CMD_DO_GRIPPER",),
    "fence": ("MAV_CMD_DO_FENCE_ENABLE",),
})  # fmt: skip
"""Confirmations that read the parameters of one command, and are of no other."""

MESSAGES: Mapping[str, MessageOffer] = MappingProxyType({
    GLOBAL_TARGET: MessageOffer(
        ("lat_int", "lon_int", "alt", "yaw"),
        GLOBAL_FRAMES,
        {"target": Offer(flight.send_target), "arrival": Offer(flight.go_to, _WAY)},
        dict.fromkeys(("target", "arrival"), ("lat_int", "lon_int", "alt")),
    ),
    LOCAL_TARGET: MessageOffer(
        ("x", "y", "z", "vx", "vy", "vz", "yaw", "yaw_rate"),
        LOCAL_FRAMES,
        {
            "target": Offer(setpoints.send_local_place),
            "arrival": Offer(setpoints.go_to_local, _WAY),
            "velocity": Offer(setpoints.send_velocity),
        },
        {"target": ("x", "y", "z"), "arrival": ("x", "y", "z"), "velocity": ("vx", "vy")},
    ),
    CHANNELS: MessageOffer(
        ("channels", *(f"chan{index}_raw" for index in range(1, setpoints.RC_CHANNELS + 1))),
        {},
        {"rc": Offer(setpoints.override_channels), "sent": Offer(setpoints.send_channels)},
        {},
    ),
})  # fmt: skip
"""Messages that are sent instead of a command: nothing acknowledges them."""

CALLS: Mapping[str, CallOffer] = MappingProxyType({
    "mission_upload": CallOffer(
        ("items", "home_first"), Offer(mission_actions.upload_mission, _ITEMS), ("items",), frames=GLOBAL_FRAMES
    ),
    "mission_download": CallOffer((), Offer(mission_actions.download_mission, _ITEMS)),
    "mission_start": CallOffer(
        (),
        Offer(
            mission_execution.start_mission, ("item", "items", "reached", "altitude", "distance"), judges_mode=True
        ),
    ),
    "mission_clear": CallOffer((), Offer(mission_actions.clear_mission)),
    "mission_set_current": CallOffer(("seq",), Offer(mission_actions.set_current), ("seq",)),
    "param_pull": CallOffer((), Offer(parameters.pull_parameters, ("params", "of"))),
    "param_get": CallOffer(("name",), Offer(parameters.get_parameter), ("name",)),
    "param_set": CallOffer(("name", "value"), Offer(parameters.set_parameter), ("name", "value")),
    "takeoff_by_mode": CallOffer(
        ("altitude",), Offer(flight.take_off_by_mode, _CLIMB), ("altitude",)
    ),
    "command": CallOffer(
        ("command", *COMMAND_FIELDS), Offer(outputs.acknowledge), ("command",), confirm="ack", frames=COMMAND_FRAMES
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
    dialect.MAV_CMD_DO_SET_SERVO: "servo",
    dialect.MAV_CMD_DO_FENCE_ENABLE: "fence",
})  # fmt: skip
"""Commands that the call `command` does not leave at the acknowledgement: what proves them is known; limits hold."""


def offer_of(entry: ActionEntry, number: int) -> Offer:
    """Return how an entry that nothing is wrong with is carried out; `number` is the command that it came to."""
    if entry.call:
        if entry.call == "command" and number in KNOWN_BETTER:
            return COMMANDS[KNOWN_BETTER[number]]
        return CALLS[entry.call].offer
    return MESSAGES[entry.message].confirm[entry.confirm] if entry.message else COMMANDS[entry.confirm]
