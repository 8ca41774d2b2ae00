"""Topics and services of mavros, each with its equivalent in MAVLink: for the paper's INI manifests.

Names, units and frames are those of mavros (its plugins sys_status, command, setpoint_position, setpoint_velocity,
global_position, home_position, waypoint, param): degrees, metres, m/s, shares of 1, local coordinates east-north-up.
Where ROS hears of an acknowledgement at most, an action is confirmed as those of manifests/copter.toml are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from msgspec.structs import replace

from schemas.files.units import Duration
from schemas.manifest.ini import Method
from schemas.manifest.model import ActionEntry, Field, FieldValue, ParameterType, PerceptEntry, Retry

NAMESPACE = "mavros"
"""The ROS namespace of its names; others may precede it: `uav1/mavros/state`."""


@dataclass(frozen=True)
class Heard:
    """A topic on which mavros publishes the vehicle's state."""

    entry: PerceptEntry
    """The MAVLink message, its rate at most, and when it is stale; the arguments come from the manifest."""
    fields: Mapping[str, Field]
    """The fields of the topic by those of that message; `list.field` is a field of the structures in a list."""
    note: str = ""
    """Differences from mavros, for people."""


@dataclass(frozen=True)
class Into:
    """Where a field of a topic or service goes, and what it may be."""

    field: str
    """Of the MAVLink command or message, or of the driver's call."""
    type: ParameterType = "float"
    unit: str = ""
    min: float | None = None
    max: float | None = None
    scale: float = 1.0
    table: str = ""

    def value(self, parameter: str) -> str | FieldValue:
        """Its entry in the manifest's `fields`."""
        if self.table:
            return FieldValue(param=parameter, table=self.table)
        return parameter if self.scale == 1.0 else FieldValue(param=parameter, scale=self.scale)


@dataclass(frozen=True)
class Taken:
    """A topic or service by which mavros takes something."""

    method: Method
    entry: ActionEntry
    """How it is carried out and confirmed; the parameters come from the manifest."""
    fields: Mapping[str, Into] = field(default_factory=dict)
    needed: tuple[str, ...] = ()
    """Fields that a manifest must name: zero, as ROS has it, would be a place or an order that nobody gave."""
    older: Mapping[str, str] = field(default_factory=dict)
    """Names of a field in earlier releases of mavros."""
    note: str = ""


_POSITION = PerceptEntry(source="GLOBAL_POSITION_INT", rate=10.0, ttl=Duration(3))
_LATITUDE = Into("lat_int", "float", "deg", -90, 90, scale=1e7)
_LONGITUDE = Into("lon_int", "float", "deg", -180, 180, scale=1e7)
_ESTIMATOR = "counted from the estimator's origin, which is where it had its first position"

_WAYPOINT = (
    "frame", "command", "is_current", "autocontinue", "param1", "param2", "param3", "param4",
    "x_lat", "y_long", "z_alt",
)  # fmt: skip
_VELOCITY = ActionEntry(
    message="SET_POSITION_TARGET_LOCAL_NED", frame="local", confirm="velocity", deadline=Duration(30), supersedes=True,
    fields={"vx": 0, "vy": 0, "vz": 0, "yaw_rate": 0},
)  # fmt: skip
_VELOCITY_NOTE = (
    "m/s east, north and up, rad/s to the left; 0 if not named; ArduPilot stops after 3 s without a new one"
)
_TWIST: Mapping[str, Into] = MappingProxyType({
    "linear.x": Into("vy", "float", "m/s"),
    "linear.y": Into("vx", "float", "m/s"),
    "linear.z": Into("vz", "float", "m/s", scale=-1),
    "angular.z": Into("yaw_rate", "float", "rad/s", scale=-1),
})  # fmt: skip
"""A velocity east-north-up in the fields of one north-east-down."""

TOPICS: Mapping[str, Heard] = MappingProxyType({
    "state": Heard(
        PerceptEntry(source="HEARTBEAT"),
        {
            name: Field(field=name)
            for name in ("mode", "connected", "armed", "guided", "manual_input", "system_status")
        },
    ),
    "global_position/global": Heard(
        _POSITION,
        {
            "latitude": Field(field="lat", scale=1e-7),
            "longitude": Field(field="lon", scale=1e-7),
            "altitude": Field(field="alt", scale=1e-3),
        },
        note="`altitude` is above mean sea level, as for `setpoint_position/global`; mavros adds the geoid's height",
    ),
    "global_position/rel_alt": Heard(
        replace(_POSITION, deadband=0.01), {"data": Field(field="relative_alt", scale=1e-3)}
    ),
    "global_position/compass_hdg": Heard(
        _POSITION,
        {"data": Field(field="hdg", scale=0.01, absent=65535)},
        note="no percept while the heading is not known; mavros publishes NaN",
    ),
    "global_position/local": Heard(
        PerceptEntry(source="LOCAL_POSITION_NED", rate=10.0, ttl=Duration(3)),
        {
            "pose.pose.position.x": Field(field="y"),
            "pose.pose.position.y": Field(field="x"),
            "pose.pose.position.z": Field(field="z", scale=-1),
            "twist.twist.linear.x": Field(field="vy"),
            "twist.twist.linear.y": Field(field="vx"),
            "twist.twist.linear.z": Field(field="vz"),
        },
        note=f"{_ESTIMATOR}; `twist.twist.linear.z` counts downwards, as in mavros",
    ),
    "home_position/home": Heard(
        PerceptEntry(source="HOME_POSITION"),
        {
            "geo.latitude": Field(field="latitude", scale=1e-7),
            "geo.longitude": Field(field="longitude", scale=1e-7),
            "geo.altitude": Field(field="altitude", scale=1e-3),
            "position.x": Field(field="y"),
            "position.y": Field(field="x"),
            "position.z": Field(field="z", scale=-1),
        },
        note="`geo.altitude` is above mean sea level; mavros adds the geoid's height",
    ),
    "battery": Heard(
        PerceptEntry(source="SYS_STATUS", rate=1.0, ttl=Duration(10)),
        {
            "voltage": Field(field="voltage_battery", scale=1e-3, absent=65535),
            "current": Field(field="current_battery", scale=-0.01, absent=-1),
            "percentage": Field(field="battery_remaining", scale=0.01, absent=-1),
        },
        note="the first battery; a current that is drawn is negative, as in ROS",
    ),
    "mission/waypoints": Heard(
        PerceptEntry(source="MISSION_LIST"),
        {"waypoints": Field(field="waypoints")} | {f"waypoints.{name}": Field(field=name) for name in _WAYPOINT},
        note="published when a mission was sent or read; the first waypoint is home, as in mavros",
    ),
    "mission/reached": Heard(PerceptEntry(source="MISSION_ITEM_REACHED"), {"wp_seq": Field(field="seq")}),
    "param/param_value": Heard(
        PerceptEntry(source="PARAM"),
        {
            "param_id": Field(field="name"),
            "value.integer": Field(field="value"),
            "value.real": Field(field="value"),
        },
        note="of parameters that were asked for or set; both forms of the value are the value",
    ),
})  # fmt: skip
"""By the name below `mavros/`: what can be perceived."""

CALLS: Mapping[str, Taken] = MappingProxyType({
    "set_mode": Taken(
        "service",
        ActionEntry(
            command="MAV_CMD_DO_SET_MODE", fields={"param1": 1}, confirm="mode", deadline=Duration(30),
            motion=False, supersedes=True,
        ),
        {"custom_mode": Into("param2", "string", table="modes")},
        ("custom_mode",),
    ),
    "cmd/arming": Taken(
        "service",
        ActionEntry(command="MAV_CMD_COMPONENT_ARM_DISARM", confirm="armed", deadline=Duration(90), motion=False),
        {"value": Into("param1", "boolean")},
        ("value",),
    ),
    "cmd/takeoff": Taken(
        "service",
        ActionEntry(
            command="MAV_CMD_NAV_TAKEOFF", confirm="altitude", tolerance=0.3, deadline=Duration(60),
            retry=Retry(times=2, every=Duration(3)), cancel="hold",
        ),
        {
            "altitude": Into("param7", "float", "m", 1, 120),
            "min_pitch": Into("param1", "float", "deg"),
            "yaw": Into("param4", "float", "deg"),
            "latitude": Into("param5", "float", "deg", -90, 90),
            "longitude": Into("param6", "float", "deg", -180, 180),
        },
        ("altitude",),
        note="`altitude` is above home; ArduCopter takes off where it is, whatever the other fields say",
    ),
    "cmd/land": Taken(
        "service",
        ActionEntry(
            command="MAV_CMD_NAV_LAND", confirm="landed", deadline=Duration(300), cancel="hold", supersedes=True
        ),
        {
            "yaw": Into("param4", "float", "deg"),
            "latitude": Into("param5", "float", "deg", -90, 90),
            "longitude": Into("param6", "float", "deg", -180, 180),
            "altitude": Into("param7", "float", "m"),
        },
        note="ArduCopter lands where it is, whatever the fields say",
    ),
    "setpoint_position/global": Taken(
        "topic",
        ActionEntry(
            message="SET_POSITION_TARGET_GLOBAL_INT", frame="amsl", confirm="target", deadline=Duration(30),
            supersedes=True,
        ),
        {
            "pose.position.latitude": _LATITUDE,
            "pose.position.longitude": _LONGITUDE,
            "pose.position.altitude": Into("alt", "float", "m"),
        },
        ("pose.position.latitude", "pose.position.longitude", "pose.position.altitude"),
        note="`altitude` is above mean sea level; succeeds when the vehicle has taken the target; "
        "the older `latitude`, `longitude`, `altitude` of GlobalPositionTarget are known, too",
        older={name: f"pose.position.{name}" for name in ("latitude", "longitude", "altitude")},
    ),
    "setpoint_position/local": Taken(
        "topic",
        ActionEntry(
            message="SET_POSITION_TARGET_LOCAL_NED", frame="local", confirm="target", deadline=Duration(30),
            supersedes=True,
        ),
        {
            "pose.position.x": Into("y", "float", "m"),
            "pose.position.y": Into("x", "float", "m"),
            "pose.position.z": Into("z", "float", "m", scale=-1),
        },
        ("pose.position.x", "pose.position.y", "pose.position.z"),
        note=f"metres east, north and up, {_ESTIMATOR}; succeeds when the vehicle has taken the target",
    ),
    "setpoint_velocity/cmd_vel_unstamped": Taken(
        "topic", _VELOCITY, _TWIST, note=_VELOCITY_NOTE
    ),
    "setpoint_velocity/cmd_vel": Taken(
        "topic", _VELOCITY, {f"twist.{name}": into for name, into in _TWIST.items()}, note=_VELOCITY_NOTE,
    ),
    "rc/override": Taken(
        "topic",
        ActionEntry(message="RC_CHANNELS_OVERRIDE", confirm="rc", deadline=Duration(15), motion=False),
        {"channels": Into("channels", "list", "us")},
        ("channels",),
        note="succeeds when the vehicle shows the channels; ArduPilot takes them from its ground station only",
    ),
    "cmd/command": Taken(
        "service",
        ActionEntry(call="command", confirm="ack", deadline=Duration(300)),
        {"command": Into("command", "int")} | {f"param{n}": Into(f"param{n}") for n in range(1, 8)},
        ("command",),
        note="succeeds when the vehicle's state shows it, where it does; else when the vehicle accepts it",
    ),
    "mission/push": Taken(
        "service",
        ActionEntry(call="mission_upload", fields={"home_first": True}, deadline=Duration(120), motion=False),
        {"waypoints": Into("items", "list")},
        ("waypoints",),
        note="the first waypoint is home, as in ArduPilot with mavros; always the whole mission",
    ),
    "mission/pull": Taken("service", ActionEntry(call="mission_download", deadline=Duration(120), motion=False)),
    "mission/clear": Taken("service", ActionEntry(call="mission_clear", deadline=Duration(120), motion=False)),
    "mission/set_current": Taken(
        "service",
        ActionEntry(call="mission_set_current", deadline=Duration(60), motion=False),
        {"wp_seq": Into("seq", "int", min=0)},
        ("wp_seq",),
    ),
    "param/pull": Taken(
        "service",
        ActionEntry(call="param_pull", deadline=Duration(120), motion=False),
        note="the values become percepts of `param/param_value`, at its `rate`",
    ),
    "param/get": Taken(
        "service",
        ActionEntry(call="param_get", deadline=Duration(30), motion=False),
        {"param_id": Into("name", "string")},
        ("param_id",),
        note="the value comes as a percept of `param/param_value`",
    ),
    "param/set": Taken(
        "service",
        ActionEntry(call="param_set", deadline=Duration(90), motion=False),
        {"param_id": Into("name", "string"), "value.integer": Into("value", "int"), "value.real": Into("value")},
        ("param_id",),
        note="one form of the value, whichever the manifest has; succeeds when the vehicle reports it",
    ),
})  # fmt: skip
"""By the name below `mavros/`: what can be done."""


def below_mavros(name: str) -> str | None:
    """Return the part of a ROS name below `mavros/`, whatever namespaces precede it; None if it has none."""
    parts = name.split("/")
    return "/".join(parts[parts.index(NAMESPACE) + 1 :]) if NAMESPACE in parts[:-1] else None
