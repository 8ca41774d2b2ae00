"""Telemetry of a simulated PX4: messages built from its state, and the intervals at which they come unasked."""

import math
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.further_messages import CurrentMode, add_message
from bridged.simulation.vehicle import telemetry as common
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.motion.tasks import Drift, GoTo, Landed, TakeOff
from bridged.simulation.vehicle.px4.modes import AVAILABLE, STANDARD, Mode
from bridged.simulation.vehicle.px4.px4 import Px4
from bridged.simulation.vehicle.telemetry import INT16, UNKNOWN_16, boot_ms, boot_us

AVAILABLE_MODES_ID, CURRENT_MODE_ID, PROTOCOL_VERSION_ID = 435, 436, 300

AvailableModes = add_message(
    435,
    "AVAILABLE_MODES",
    134,
    ("custom_mode", "uint32_t", "I", 0),
    ("properties", "uint32_t", "I", 0),
    ("number_modes", "uint8_t", "B", 0),
    ("mode_index", "uint8_t", "B", 0),
    ("standard_mode", "uint8_t", "B", 0),
    ("mode_name", "char", "s", 35),
)
ProtocolVersion = add_message(
    300,
    "PROTOCOL_VERSION",
    217,
    ("version", "uint16_t", "H", 0),
    ("min_version", "uint16_t", "H", 0),
    ("max_version", "uint16_t", "H", 0),
    ("spec_version_hash", "uint8_t", "B", 8),
    ("library_version_hash", "uint8_t", "B", 8),
)
"""Messages that only a simulated PX4 sends; their checksum seeds are those of the recorded packets."""

_PRESENT, _ENABLED, _HEALTHY, _STICKS, _PREARM = 33603631, 33669167, 52480063, 1 << 16, 1 << 28
"""Recorded bits of SYS_STATUS, and those that change: sticks that are read, all checks passed."""
CAPABILITIES = 59647
"""capabilities of AUTOPILOT_VERSION (recorded)."""
_VERSION, _OS_VERSION = 18022464, 101854463
_ALIGNING, _ESTIMATING = 229, 1023
"""flags of ESTIMATOR_STATUS before and after it has a position."""
_HORIZONTAL = 8 | 16 | 256 | 512
"""Those of its position."""
FIX_TYPE = 3

Builder = Callable[[Px4], dialect.MAVLink_message | None]
"""Builds a message, or None while it has no content."""


def heartbeat(px4: Px4) -> dialect.MAVLink_message:
    """HEARTBEAT"""
    base_mode = (81 if px4.mode.piloted else 17 if px4.mode in (Mode.OFFBOARD, Mode.ORBIT) else 29) | px4.armed << 7
    status = 5 if px4.failsafes.acting else 4 if px4.armed else 3 if px4.healthy else 0
    return dialect.MAVLink_heartbeat_message(px4.TYPE, 12, base_mode, int(px4.mode), status, 3)


def current_mode(px4: Px4) -> dialect.MAVLink_message:
    """CURRENT_MODE"""
    return CurrentMode(int(px4.mode), int(px4.intended), STANDARD.get(px4.mode, 0))


def available_modes() -> list[dialect.MAVLink_message]:
    """AVAILABLE_MODES: one message for each mode."""
    return [
        AvailableModes(
            int(mode), properties, len(AVAILABLE), number, STANDARD.get(Mode(mode), 0) if mode in set(Mode) else 0,
            name.encode(),
        )
        for number, (mode, properties, name) in enumerate(AVAILABLE, 1)
    ]  # fmt: skip


def sys_status(px4: Px4) -> dialect.MAVLink_message:
    """SYS_STATUS"""
    sticks = _STICKS if px4.sticks.alive(px4.now) else 0
    healthy = _HEALTHY | sticks | (_PREARM if px4.healthy else 0)
    battery = px4.battery
    return dialect.MAVLink_sys_status_message(
        _PRESENT | sticks, _ENABLED, healthy, 0, round(battery.voltage * 1000), -1, battery.remaining,
        0, 0, 0, 0, 0, 0,
    )  # fmt: skip


def gps_raw_int(px4: Px4) -> dialect.MAVLink_message:
    """GPS_RAW_INT"""
    known = common.gps_raw_int(px4, FIX_TYPE, (70, 110), (900, 1780, 400))
    nothing = (boot_us(px4), 0, 0, 0, 0, UNKNOWN_16, UNKNOWN_16, 0, 0, 0)
    return dialect.MAVLink_gps_raw_int_message(*nothing) if known is None else known


def altitude(px4: Px4) -> dialect.MAVLink_message:
    """ALTITUDE"""
    above_sea = px4.place.alt
    relative = px4.motion.up.position - px4.home_on_chart.up
    return dialect.MAVLink_altitude_message(
        boot_us(px4), above_sea, above_sea, px4.motion.up.position, relative, math.nan, math.nan
    )


def battery_status(px4: Px4) -> dialect.MAVLink_message:
    """BATTERY_STATUS"""
    battery = px4.battery
    return dialect.MAVLink_battery_status_message(
        0, 1, 1, INT16, [round(battery.voltage * 1000), *([UNKNOWN_16] * 9)], -1, 0, -1, battery.remaining, 0,
        int(battery.state),
    )  # fmt: skip


def estimator_status(px4: Px4) -> dialect.MAVLink_message:
    """ESTIMATOR_STATUS"""
    flags = _ESTIMATING if px4.ready else _ALIGNING
    if px4.estimate.lost:
        flags &= ~_HORIZONTAL
    return dialect.MAVLink_estimator_status_message(boot_us(px4), flags, 0, 0, 0, 0, 0, 0, 0.1, 0.1)


def position_target_global_int(px4: Px4) -> dialect.MAVLink_message | None:
    """POSITION_TARGET_GLOBAL_INT: the place that an AUTO mode goes to or holds; not on the ground."""
    if not px4.mode.automatic or not px4.armed or px4.flight.landed is Landed.ON_GROUND:
        return None
    target, here = px4.flight.target, px4.motion.position
    if target is None:
        task = px4.flight.task
        target = Vector(here.north, here.east, task.up if isinstance(task, TakeOff) else here.up)
    goal = px4.chart.place(target)
    return dialect.MAVLink_position_target_global_int_message(
        boot_ms(px4), 5, 0, goal.lat_e7, goal.lon_e7, goal.alt, *(math.nan,) * 3, 0, 0, 0, px4.motion.heading, 0
    )


def position_target_local_ned(px4: Px4) -> dialect.MAVLink_message:
    """POSITION_TARGET_LOCAL_NED: the setpoint of the controllers."""
    task, nothing = px4.flight.task, math.nan
    place, velocity, mask = Vector(nothing, nothing, nothing), Vector(nothing, nothing, nothing), 63
    if px4.flight.airborne:
        if isinstance(task, Drift):
            velocity, mask = task.velocity, 7
        elif isinstance(task, GoTo):
            place, mask = task.goal, 0
        else:
            place, mask = px4.motion.position, 0
    rate = task.turn_rate or 0.0 if isinstance(task, Drift) else 0.0
    return dialect.MAVLink_position_target_local_ned_message(
        boot_ms(px4), dialect.MAV_FRAME_LOCAL_NED, mask, place.north, place.east, -place.up,
        velocity.north, velocity.east, -velocity.up, 0, 0, 0, px4.motion.heading, rate,
    )  # fmt: skip


def mission_current(px4: Px4) -> dialect.MAVLink_message:
    """MISSION_CURRENT"""
    mission = px4.missions
    total = len(mission.items) or UNKNOWN_16
    return dialect.MAVLink_mission_current_message(
        mission.current, total, int(px4.navigator.state), 1 if px4.mode is Mode.MISSION else 2
    )


def orbit_execution_status(px4: Px4) -> dialect.MAVLink_message | None:
    """ORBIT_EXECUTION_STATUS, while it circles."""
    circle = px4.circle
    if circle is None or not px4.flight.airborne:
        return None
    centre = px4.chart.place(circle.centre)
    return dialect.MAVLink_orbit_execution_status_message(
        boot_us(px4), circle.radius, 0, centre.lat_e7, centre.lon_e7, centre.alt
    )


def autopilot_version(px4: Px4) -> dialect.MAVLink_message:
    """AUTOPILOT_VERSION"""
    del px4
    return dialect.MAVLink_autopilot_version_message(
        CAPABILITIES, _VERSION, _VERSION, _OS_VERSION, 1, list(b"argosy\0\0"), list(b"argosy\0\0"), [0] * 8, 0, 0, 0,
        [0] * 18,
    )  # fmt: skip


def servo_output_raw(px4: Px4) -> dialect.MAVLink_message:
    """SERVO_OUTPUT_RAW of MAIN"""
    pulses = px4.outputs.pulses(armed=px4.armed, airborne=px4.flight.airborne)
    return dialect.MAVLink_servo_output_raw_message(boot_us(px4) % 2**32, 0, *pulses)


def extended_sys_state(px4: Px4) -> dialect.MAVLink_message:
    """EXTENDED_SYS_STATE"""
    return dialect.MAVLink_extended_sys_state_message(0, int(px4.flight.landed))


def _estimates(px4: Px4) -> bool:
    return px4.home is not None and not px4.estimate.lost


BUILDERS: dict[int, Builder] = {
    0: heartbeat,
    1: sys_status,
    2: common.system_time,
    24: gps_raw_int,
    30: common.attitude,
    32: lambda px4: common.local_position_ned(px4) if _estimates(px4) else None,
    33: lambda px4: common.global_position_int(px4) if _estimates(px4) else None,
    36: servo_output_raw,
    49: common.gps_global_origin,
    74: lambda px4: common.vfr_hud(px4, throttle=50, has_airspeed=px4.has_airspeed),
    85: position_target_local_ned,
    87: position_target_global_int,
    141: altitude,
    147: battery_status,
    230: estimator_status,
    241: common.vibration,
    242: lambda px4: common.home_position(px4, attitude=1.0),
    245: extended_sys_state,
    360: orbit_execution_status,
    CURRENT_MODE_ID: current_mode,
    42: mission_current,
}
"""Messages by id that are streamed; MISSION_CURRENT is no stream for SET_MESSAGE_INTERVAL."""

REQUESTED: dict[int, Builder] = {
    **{number: builder for number, builder in BUILDERS.items() if number != 42},
    148: autopilot_version,
    PROTOCOL_VERSION_ID: lambda px4: ProtocolVersion(200, 100, 203, [0] * 8, list(b"argosy\0\0")),
}
"""Messages by id for REQUEST_MESSAGE."""

NOT_SIMULATED = frozenset((
    4, 8, 26, 29, 31, 62, 65, 83, 105, 106, 111, 116, 132, 225, 231, 290, 291, 331, 350, 380, 395, 410, 411, 441,
    514, 12901, 12904,
))  # fmt: skip
"""Streams that PX4 has and that are not simulated: their interval may be set, and nothing comes."""

STREAMS = (frozenset(BUILDERS) | NOT_SIMULATED) - {42}

DEFAULTS_S = {
    0: 1.0, 1: 0.5, 2: 1.0, 24: 0.5, 30: 0.2, 32: 0.2, 33: 0.2, 36: 1.0, 42: 1.0, 74: 0.5, 85: 0.2, 87: 0.5, 141: 0.5,
    147: 2.0, 230: 1.0, 241: 2.0, 242: 2.0, 245: 0.5, 360: 0.2, CURRENT_MODE_ID: 2.0,
}  # fmt: skip
"""Intervals after power on. The real one sends positions and attitude 10 to 20 times as often."""
