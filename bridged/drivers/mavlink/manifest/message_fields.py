"""Messages that autopilots and other ground stations' wishes put on a link, and the fields of those that are read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pymavlink.dialects.v20 import ardupilotmega as dialect

from schemas.manifest.loader import Manifest

FOR_PERCEPTS_ONLY = (
    "AHRS", "AHRS2", "AHRS3", "ALTITUDE", "ATTITUDE", "ATTITUDE_QUATERNION", "ATTITUDE_TARGET", "DISTANCE_SENSOR",
    "ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8", "GPS2_RAW", "GPS_RTK", "HIGHRES_IMU", "HWSTATUS", "MCU_STATUS",
    "MEMINFO", "OPTICAL_FLOW", "PID_TUNING", "POWER_STATUS", "RAW_IMU", "RC_CHANNELS_RAW", "RC_CHANNELS_SCALED",
    "SCALED_IMU", "SCALED_IMU2", "SCALED_IMU3", "SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3",
    "SENSOR_OFFSETS", "SIMSTATE", "SIM_STATE", "TERRAIN_REPORT", "TIMESYNC", "VFR_HUD", "VIBRATION",
    "WIND",
)  # fmt: skip
"""Telemetry that the driver itself never looks at: read only if a percept is made of it."""


def unread(manifest: Manifest) -> frozenset[int]:
    """Ids of the messages that nobody reads: they need not be decoded."""
    sources = {percept.source for percept in manifest.percepts.values()}
    return frozenset(getattr(dialect, f"MAVLINK_MSG_ID_{name}") for name in FOR_PERCEPTS_ONLY if name not in sources)


class MessageFields(Mapping[str, object]):
    """The fields of a message by name; texts are strings. Only those that are asked for are converted."""

    def __init__(self, message: dialect.MAVLink_message) -> None:
        self._message = message

    def __getitem__(self, name: str) -> object:
        if name not in self._message.fieldnames:
            raise KeyError(name)
        value: object = self._message.format_attr(name)
        return value

    def __iter__(self) -> Iterator[str]:
        return iter(self._message.fieldnames)

    def __len__(self) -> int:
        return len(self._message.fieldnames)
