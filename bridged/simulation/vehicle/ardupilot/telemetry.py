"""Telemetry of a simulated ArduPilot: messages built from its state, and their stream intervals."""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle import telemetry as common
from bridged.simulation.vehicle.ardupilot.ardupilot import ArduPilot
from bridged.simulation.vehicle.ardupilot.boot import Milestone
from bridged.simulation.vehicle.messages import Streams
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Drift, TakeOff
from bridged.simulation.vehicle.telemetry import INT16, UNKNOWN_16, boot_ms, boot_us

FIX_TYPE = 6
"""GPS fix of the recorded simulated vehicle (RTK fixed)."""

TARGET_TYPE_MASK = 65016
"""type_mask of POSITION_TARGET_GLOBAL_INT: only the position counts."""

LOCAL_POSITION_MASK = 3576
LOCAL_VELOCITY_MASK = 3527
"""type_mask of POSITION_TARGET_LOCAL_NED: only the position counts, or only the velocity."""

_SENSORS_PRESENT = 1399979023
_SENSORS_ENABLED = 1380031503
_SENSORS_HEALTHY = 1196530703
_GPS, _POSITION_CONTROL, _FENCE, _AHRS, _LOGGING, _PREARM = 1 << 5, 3 << 13, 1 << 20, 1 << 21, 1 << 24, 1 << 28
"""Recorded bits of SYS_STATUS, and those that change."""

Builder = Callable[[ArduPilot], dialect.MAVLink_message | None]
"""Builds a message, or None while it has no content."""


def heartbeat(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """HEARTBEAT"""
    return dialect.MAVLink_heartbeat_message(
        ardupilot.TYPE, 3, ardupilot.base_mode, int(ardupilot.mode), ardupilot.system_status, 3
    )


def sys_status(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """SYS_STATUS"""
    present, enabled, healthy = _SENSORS_PRESENT, _SENSORS_ENABLED, _SENSORS_HEALTHY
    if ardupilot.passed(Milestone.GPS_FIX):
        present, enabled, healthy = present | _GPS, enabled | _GPS, healthy | (_GPS if ardupilot.gps_place else 0)
    if ardupilot.passed(Milestone.HOME):
        enabled, healthy = enabled | _AHRS, healthy | _AHRS
    if ardupilot.mode.autonomous:
        enabled, healthy = enabled | _POSITION_CONTROL, healthy | _POSITION_CONTROL
    if ardupilot.armed:
        enabled |= _LOGGING
    if ardupilot.fence.enabled:
        enabled |= _FENCE
    if ardupilot.passed(Milestone.PREARM_GOOD) and ardupilot.gps_place and not ardupilot.hindrance:
        healthy |= _PREARM
    battery = ardupilot.battery
    return dialect.MAVLink_sys_status_message(
        present, enabled, healthy, 0, _milli(battery.voltage), round(battery.current * 100), battery.remaining,
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def gps_raw_int(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """GPS_RAW_INT"""
    known = common.gps_raw_int(ardupilot, FIX_TYPE, (121, 200), (300, 300, 0))
    nothing = (0, int(ardupilot.has_fix), 0, 0, 0, UNKNOWN_16, UNKNOWN_16, 0, 0, 0)
    return dialect.MAVLink_gps_raw_int_message(*nothing) if known is None else known


def battery_status(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """BATTERY_STATUS"""
    battery = ardupilot.battery
    return dialect.MAVLink_battery_status_message(
        0, 0, 0, INT16, [_milli(battery.voltage), *([UNKNOWN_16] * 9)], round(battery.current * 100),
        round(battery.used), round(battery.used * battery.voltage * 0.036), battery.remaining, 0, battery.state,
    )  # fmt: skip


def position_target_global_int(ardupilot: ArduPilot) -> dialect.MAVLink_message | None:
    """POSITION_TARGET_GLOBAL_INT: the goal, also one that came while the motors were off (as recorded)."""
    target = ardupilot.flight.target
    if target is None or not ardupilot.reports_target:
        return None
    goal = ardupilot.chart.place(target)
    return dialect.MAVLink_position_target_global_int_message(
        boot_ms(ardupilot), 0, TARGET_TYPE_MASK, goal.lat_e7, goal.lon_e7, goal.alt, 0, 0, 0, 0, 0, 0, 0, 0
    )


def nav_controller_output(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """NAV_CONTROLLER_OUTPUT"""
    roll, pitch = ardupilot.motion.tilt
    target, at = ardupilot.flight.target, ardupilot.motion.position
    away, course, above = 0.0, ardupilot.motion.bearing, 0.0
    if target is not None:
        north, east = target.north - at.north, target.east - at.east
        away, above = math.hypot(north, east), target.up - at.up
        course = math.degrees(math.atan2(east, north)) % 360.0
    bearing_now = round(math.remainder(course, 360.0))
    return dialect.MAVLink_nav_controller_output_message(
        math.degrees(roll), math.degrees(pitch), bearing_now, bearing_now, min(UNKNOWN_16, round(away)), above, 0, 0
    )


def mission_current(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """MISSION_CURRENT"""
    mission, flying = ardupilot.mission, ardupilot.mode is ardupilot.MODES.AUTO
    state = 1 if not mission.items else 5 if mission.complete else 3 if flying else 2
    return dialect.MAVLink_mission_current_message(mission.current, len(mission.items), state, 1 if flying else 0)


def autopilot_version(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """AUTOPILOT_VERSION"""
    return dialect.MAVLink_autopilot_version_message(
        ardupilot.CAPABILITIES, 4 << 24 | 7 << 16, 0, 0, 0, list(b"argosy\0\0"), [0] * 8, [0] * 8, 0, 0, 0,
        list(f"simulated {ardupilot.NAME}".encode().ljust(18, b"\0")),
    )  # fmt: skip


def ekf_status_report(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """EKF_STATUS_REPORT"""
    estimate = ardupilot.estimate
    flags = ardupilot.boot.ekf_flags(ardupilot.now, lost=estimate.lost, glitching=estimate.glitching)
    return dialect.MAVLink_ekf_status_report_message(flags, *(0,) * 6)


def rc_channels(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """RC_CHANNELS: the pilot's transmitter, with the overrides of a ground station."""
    pulses = ardupilot.transmitter.pulses(ardupilot.now)
    return dialect.MAVLink_rc_channels_message(boot_ms(ardupilot), len(pulses), *pulses, 0, 0, 255)


def servo_output_raw(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """SERVO_OUTPUT_RAW: 16 outputs, the first four are motors; 0 is no pulse."""
    pulses = ardupilot.outputs.pulses(armed=ardupilot.armed, airborne=ardupilot.flight.airborne)
    return dialect.MAVLink_servo_output_raw_message(boot_us(ardupilot) % 2**32, 0, *pulses)


def wind(ardupilot: ArduPilot) -> dialect.MAVLink_message:
    """WIND: from where it blows, in degrees from -180 to 180 (recorded)."""
    air = ardupilot.motion.air
    direction = math.degrees(math.atan2(-air.east, -air.north))
    return dialect.MAVLink_wind_message(direction, math.hypot(air.north, air.east), 0.0)


def fence_status(ardupilot: ArduPilot) -> dialect.MAVLink_message | None:
    """FENCE_STATUS, while the fence is enabled."""
    fence = ardupilot.fence
    if not fence.enabled:
        return None
    kind = 0 if fence.breached is None else 2 if "Alt" in fence.breached else 3
    return dialect.MAVLink_fence_status_message(
        int(fence.breached is not None), fence.breaches, kind, round(fence.breached_at * 1000)
    )


def position_target_local_ned(ardupilot: ArduPilot) -> dialect.MAVLink_message | None:
    """POSITION_TARGET_LOCAL_NED in GUIDED: the goal, or the velocity that is flown (0 while it hovers)."""
    if ardupilot.mode is not ardupilot.MODES.GUIDED:
        return None
    task, target = ardupilot.flight.task, ardupilot.flight.target
    if isinstance(task, TakeOff):
        target = Vector(ardupilot.motion.north.target, ardupilot.motion.east.target, task.up)
    mask, at, velocity = LOCAL_POSITION_MASK, target or Vector(), Vector()
    if target is None:
        mask = LOCAL_VELOCITY_MASK
        velocity = task.velocity if isinstance(task, Drift) else velocity
    return dialect.MAVLink_position_target_local_ned_message(
        boot_ms(ardupilot), dialect.MAV_FRAME_LOCAL_NED, mask, at.north, at.east, -at.up,
        velocity.north, velocity.east, -velocity.up, 0, 0, 0, 0, 0,
    )  # fmt: skip


BUILDERS: dict[int, Builder] = {
    0: heartbeat,
    1: sys_status,
    2: common.system_time,
    24: gps_raw_int,
    30: common.attitude,
    32: lambda ardupilot: common.local_position_ned(ardupilot) if ardupilot.has_position else None,
    33: lambda ardupilot: common.global_position_int(ardupilot, known=ardupilot.has_fix),
    36: servo_output_raw,
    42: mission_current,
    49: lambda ardupilot: common.gps_global_origin(ardupilot) if ardupilot.passed(Milestone.HOME) else None,
    62: nav_controller_output,
    65: rc_channels,
    74: lambda ardupilot: common.vfr_hud(ardupilot, throttle=37),
    85: position_target_local_ned,
    87: position_target_global_int,
    125: lambda ardupilot: dialect.MAVLink_power_status_message(5000, 0, 0),
    147: battery_status,
    148: autopilot_version,
    152: lambda ardupilot: dialect.MAVLink_meminfo_message(0, UNKNOWN_16, 131072),
    162: fence_status,
    168: wind,
    193: ekf_status_report,
    241: common.vibration,
    242: common.home_position,
    281: lambda ardupilot: ardupilot.payload.gimbal.status(boot_ms(ardupilot)),
    285: lambda ardupilot: ardupilot.payload.gimbal.attitude(ardupilot.place, ardupilot.motion.heading, ardupilot.now),
    376: lambda ardupilot: ardupilot.payload.relay_status(ardupilot.now),
    9005: lambda ardupilot: ardupilot.payload.winch_status(ardupilot.now),
    245: lambda ardupilot: dialect.MAVLink_extended_sys_state_message(ardupilot.VTOL_STATE, ardupilot.landed_state),
}
"""Messages by id that can be asked for."""


def _milli(value: float) -> int:
    return max(0, min(UNKNOWN_16 - 1, round(value * 1000)))


GROUPS: dict[int, tuple[int, ...]] = {
    1: (),  # RAW_SENSORS: no raw sensors are simulated
    2: (1, 24, 42, 62, 87, 125, 152, 162),  # EXTENDED_STATUS
    3: (36, 65),  # RC_CHANNELS
    6: (32, 33),  # POSITION
    10: (30,),  # EXTRA1
    11: (74,),  # EXTRA2
    12: (2, 147, 193, 241),  # EXTRA3
}
"""Stream groups of REQUEST_DATA_STREAM (MAV_DATA_STREAM), as ArduPilot fills them."""

ALL_GROUPS = 0


def request_group(streams: Streams, group: int, rate: int, now: float, *, on: bool) -> None:
    """REQUEST_DATA_STREAM at `now` (s): the messages of a `group` (MAV_DATA_STREAM) at `rate` Hz, or not at all."""
    groups = GROUPS.values() if group == ALL_GROUPS else (GROUPS.get(group, ()),)
    interval_us = 1e6 / rate if on and rate > 0 else -1.0
    for messages in groups:
        for message in messages:
            streams.set(message, interval_us, now)
