"""Parameters of simulated ArduPilots: names and defaults for what the simulation or a client uses."""

from bridged.simulation.vehicle.parameters import Kind, Row

SERVOS = 16
"""Servo outputs; the first four drive the motors."""

_MOTOR_FUNCTIONS = (33, 34, 35, 36)


def _servo(number: int) -> tuple[tuple[str, float, Kind], ...]:
    function = _MOTOR_FUNCTIONS[number - 1] if number <= len(_MOTOR_FUNCTIONS) else 0
    return (
        (f"SERVO{number}_FUNCTION", function, Kind.INT16),
        (f"SERVO{number}_MIN", 1100, Kind.INT16),
        (f"SERVO{number}_MAX", 1900, Kind.INT16),
        (f"SERVO{number}_TRIM", 1500, Kind.INT16),
    )


COPTER: tuple[Row, ...] = (
    ("FORMAT_VERSION", 120, Kind.INT16),
    ("MAV_SYSID", 1, Kind.INT16),
    ("MAV_GCS_SYSID", 255, Kind.INT16),
    ("PILOT_THR_FILT", 0, Kind.REAL32),
    ("PILOT_TKOFF_ALT", 0, Kind.REAL32),
    ("PILOT_SPEED_UP", 250, Kind.INT16),
    ("PILOT_SPEED_DN", 0, Kind.INT16),
    ("FS_GCS_ENABLE", 0, Kind.INT8),
    ("FS_GCS_TIMEOUT", 5, Kind.REAL32),
    ("FS_THR_ENABLE", 1, Kind.INT8),
    ("FS_EKF_ACTION", 1, Kind.INT8),
    ("FS_OPTIONS", 16, Kind.INT32),
    ("RTL_ALT", 1500, Kind.INT32),
    ("RTL_ALT_FINAL", 0, Kind.INT16),
    ("RTL_CLIMB_MIN", 0, Kind.INT16),
    ("RTL_CONE_SLOPE", 3, Kind.REAL32),
    ("RTL_LOIT_TIME", 5000, Kind.INT32),
    ("RTL_SPEED", 0, Kind.INT16),
    ("WPNAV_SPEED", 1000, Kind.REAL32),
    ("WPNAV_RADIUS", 200, Kind.REAL32),
    ("WPNAV_SPEED_UP", 250, Kind.REAL32),
    ("WPNAV_SPEED_DN", 150, Kind.REAL32),
    ("WPNAV_ACCEL", 250, Kind.REAL32),
    ("WPNAV_ACCEL_Z", 100, Kind.REAL32),
    ("LAND_SPEED", 50, Kind.INT16),
    ("LAND_SPEED_HIGH", 0, Kind.INT16),
    ("LAND_ALT_LOW", 1000, Kind.INT16),
    ("GUID_TIMEOUT", 3, Kind.REAL32),
    ("GUID_OPTIONS", 0, Kind.INT32),
    ("DISARM_DELAY", 10, Kind.INT8),
    ("ARMING_CHECK", 1, Kind.INT32),
    ("FENCE_ENABLE", 0, Kind.INT8),
    ("FENCE_TYPE", 7, Kind.INT8),
    ("FENCE_ACTION", 1, Kind.REAL32),
    ("FENCE_ALT_MAX", 100, Kind.REAL32),
    ("FENCE_RADIUS", 300, Kind.REAL32),
    ("FENCE_MARGIN", 2, Kind.REAL32),
    ("FENCE_TOTAL", 0, Kind.INT8),
    ("BATT_MONITOR", 4, Kind.INT8),
    ("BATT_CAPACITY", 3300, Kind.INT32),
    ("BATT_LOW_VOLT", 0, Kind.REAL32),
    ("BATT_LOW_MAH", 0, Kind.REAL32),
    ("BATT_LOW_TIMER", 10, Kind.INT8),
    ("BATT_CRT_VOLT", 0, Kind.REAL32),
    ("BATT_CRT_MAH", 0, Kind.REAL32),
    ("BATT_FS_LOW_ACT", 0, Kind.INT8),
    ("BATT_FS_CRT_ACT", 0, Kind.INT8),
    ("FLTMODE_CH", 5, Kind.INT8),
    ("FLTMODE1", 7, Kind.INT8),
    ("FLTMODE2", 9, Kind.INT8),
    ("FLTMODE3", 6, Kind.INT8),
    ("FLTMODE4", 3, Kind.INT8),
    ("FLTMODE5", 5, Kind.INT8),
    ("FLTMODE6", 0, Kind.INT8),
    ("FRAME_CLASS", 1, Kind.INT8),
    ("FRAME_TYPE", 0, Kind.INT8),
    ("MIS_TOTAL", 0, Kind.INT16),
    ("MIS_RESTART", 0, Kind.INT8),
    ("MOT_THST_HOVER", 0.39, Kind.REAL32),
    ("RCMAP_ROLL", 1, Kind.INT8),
    ("RCMAP_PITCH", 2, Kind.INT8),
    ("RCMAP_THROTTLE", 3, Kind.INT8),
    ("RCMAP_YAW", 4, Kind.INT8),
    ("RC_OVERRIDE_TIME", 3, Kind.REAL32),
    ("LOIT_SPEED", 1250, Kind.REAL32),
    ("GRIP_ENABLE", 0, Kind.INT8),
    ("GRIP_TYPE", 1, Kind.INT8),
    ("GRIP_GRAB", 1900, Kind.INT16),
    ("GRIP_RELEASE", 1100, Kind.INT16),
    ("SIM_BATT_VOLTAGE", 12.6, Kind.REAL32),
    ("SIM_BATT_CAP_AH", 0, Kind.REAL32),
    ("SERIAL0_PROTOCOL", 2, Kind.INT8),
    ("STAT_RUNTIME", 0, Kind.INT32),
    ("STAT_FLTTIME", 0, Kind.INT32),
    ("WP_YAW_BEHAVIOR", 2, Kind.INT8),
    *(row for number in range(1, SERVOS + 1) for row in _servo(number)),
)


_SHARED = (
    "FORMAT_VERSION", "MAV_SYSID", "MAV_GCS_SYSID", "FENCE_", "BATT_", "FLTMODE", "MIS_TOTAL", "MIS_RESTART", "RCMAP_",
    "RC_OVERRIDE_TIME", "GRIP_", "SIM_BATT", "SERIAL0", "STAT_", "SERVO",
)  # fmt: skip
_COMMON: tuple[Row, ...] = tuple(row for row in COPTER if row[0].startswith(_SHARED))
"""Parameters of copters that planes and rovers have too."""

PLANE: tuple[Row, ...] = (
    ("AIRSPEED_CRUISE", 22, Kind.REAL32),
    ("ARMING_REQUIRE", 1, Kind.INT8),
    ("FS_GCS_ENABL", 0, Kind.INT8),
    ("FS_LONG_ACTN", 0, Kind.INT8),
    ("FS_LONG_TIMEOUT", 5, Kind.REAL32),
    ("FS_SHORT_ACTN", 0, Kind.INT8),
    ("FS_SHORT_TIMEOUT", 1.5, Kind.REAL32),
    ("LAND_DISARMDELAY", 20, Kind.INT8),
    ("RTL_ALTITUDE", 100, Kind.REAL32),
    ("RTL_AUTOLAND", 0, Kind.INT8),
    ("RTL_RADIUS", 0, Kind.INT16),
    ("THR_FAILSAFE", 1, Kind.INT8),
    ("TKOFF_ALT", 50, Kind.INT16),
    ("TKOFF_DIST", 200, Kind.INT16),
    ("TKOFF_LVL_ALT", 10, Kind.INT16),
    ("WP_LOITER_RAD", 80, Kind.INT16),
    ("WP_RADIUS", 50, Kind.INT16),
    *_COMMON,
)

ROVER: tuple[Row, ...] = (
    ("CRUISE_SPEED", 5, Kind.REAL32),
    ("FS_ACTION", 2, Kind.INT8),
    ("FS_GCS_ENABLE", 0, Kind.INT8),
    ("FS_GCS_TIMEOUT", 5, Kind.REAL32),
    ("FS_TIMEOUT", 1.5, Kind.REAL32),
    ("MIS_DONE_BEHAVE", 0, Kind.INT8),
    ("RTL_SPEED", 0, Kind.REAL32),
    ("WP_RADIUS", 3, Kind.REAL32),
    ("WP_SPEED", 5, Kind.REAL32),
    *_COMMON,
)
