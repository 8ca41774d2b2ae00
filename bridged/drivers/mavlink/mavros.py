"""What mavros calls the topics and services of a vehicle, and what each is in MAVLink: for the paper's INI manifests.

Names, units and frames are those of mavros (its plugins sys_status, command, setpoint_position, setpoint_velocity,
global_position, home_position, waypoint, param): degrees, metres, m/s, shares of 1, local coordinates east-north-up.
Where ROS hears of an acknowledgement at most, an action is confirmed as those of manifests/arducopter.toml are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from schemas.durations import Duration
from schemas.ini_manifest import Method
from schemas.manifest_entries import ActionEntry, Field, FieldValue, ParameterType, Retry

NAMESPACE = "mavros"
"""The ROS namespace of its names; others may stand before it: `uav1/mavros/state`."""


@dataclass(frozen=True)
class Heard:
    """A topic on which mavros tells something of the vehicle."""

    source: str
    """The MAVLink message."""
    fields: Mapping[str, Field]
    """What each field of the topic is in that message."""
    rate: float | None = None
    """Hz that the vehicle is asked for at most; the manifest's own rate may lower it."""
    ttl: Duration | None = None
    deadband: float = 0.0
    note: str = ""
    """What differs from mavros, for people."""


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
        """What the manifest's `fields` says of it."""
        if self.scale == 1.0 and not self.table:
            return parameter
        return FieldValue(param=parameter, scale=self.scale, table=self.table)


@dataclass(frozen=True)
class Taken:
    """A topic or service by which mavros is told something."""

    method: Method
    entry: ActionEntry
    """How it is carried out and confirmed; the parameters come from the manifest."""
    fields: Mapping[str, Into] = field(default_factory=dict)
    needed: tuple[str, ...] = ()
    """Fields without which it says nothing."""
    note: str = ""


_POSITION_RATE, _POSITION_TTL = 10.0, Duration(3)
_LATITUDE = Into("lat_int", "float", "deg", -90, 90, scale=1e7)
_LONGITUDE = Into("lon_int", "float", "deg", -180, 180, scale=1e7)
_ESTIMATOR = "counted from the estimator's origin, which is where it had its first position"

TOPICS: Mapping[str, Heard] = MappingProxyType({
    "state": Heard("HEARTBEAT", {name: Field(field=name) for name in ("mode", "connected", "armed")}),
    "global_position/global": Heard(
        "GLOBAL_POSITION_INT",
        {
            "latitude": Field(field="lat", scale=1e-7),
            "longitude": Field(field="lon", scale=1e-7),
            "altitude": Field(field="alt", scale=1e-3),
        },
        _POSITION_RATE, _POSITION_TTL,
        note="`altitude` is above mean sea level, as for `setpoint_position/global`; mavros adds the geoid's height",
    ),
    "global_position/rel_alt": Heard(
        "GLOBAL_POSITION_INT", {"data": Field(field="relative_alt", scale=1e-3)}, _POSITION_RATE, _POSITION_TTL, 0.01
    ),
    "global_position/compass_hdg": Heard(
        "GLOBAL_POSITION_INT", {"data": Field(field="hdg", scale=0.01, absent=65535)}, _POSITION_RATE, _POSITION_TTL,
        note="no percept while the heading is not known; mavros tells NaN",
    ),
    "global_position/local": Heard(
        "LOCAL_POSITION_NED",
        {
            "pose.pose.position.x": Field(field="y"),
            "pose.pose.position.y": Field(field="x"),
            "pose.pose.position.z": Field(field="z", scale=-1),
            "twist.twist.linear.x": Field(field="vy"),
            "twist.twist.linear.y": Field(field="vx"),
            "twist.twist.linear.z": Field(field="vz"),
        },
        _POSITION_RATE, _POSITION_TTL,
        note=f"{_ESTIMATOR}; `twist.twist.linear.z` counts downwards, as mavros tells it",
    ),
    "home_position/home": Heard(
        "HOME_POSITION",
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
        "SYS_STATUS",
        {
            "voltage": Field(field="voltage_battery", scale=1e-3, absent=65535),
            "current": Field(field="current_battery", scale=-0.01, absent=-1),
            "percentage": Field(field="battery_remaining", scale=0.01, absent=-1),
        },
        1.0, Duration(10),
        note="the first battery; a current that is drawn is negative, as in ROS",
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
        note="`altitude` is above mean sea level; succeeds when the vehicle has taken the target",
    ),
})  # fmt: skip
"""By the name below `mavros/`: what can be done."""


def below_mavros(name: str) -> str | None:
    """Return the part of a ROS name below `mavros/`, whatever namespaces stand before it; None if it has none."""
    parts = name.split("/")
    return "/".join(parts[parts.index(NAMESPACE) + 1 :]) if NAMESPACE in parts[:-1] else None
