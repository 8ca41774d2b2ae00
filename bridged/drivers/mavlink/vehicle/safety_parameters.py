"""Parameters that a vehicle's safety depends on, of ArduPilot and PX4, and those that a vehicle keeps for itself.

Source: the parameter references of ArduPilot 4.6 and 4.7 (copter, plane, rover) and PX4 1.16.
"""

from __future__ import annotations

import re

_KINDS = {
    "arming": r"ARMING_\w+|BRD_SAFETY\w*|COM_ARM_\w+|COM_PREARM_MODE|COM_DISARM_\w+|CBRK_\w+",
    "battery failsafe": r"BATT\d?_(FS|LOW|CRT|ARM|MONITOR)\w*|COM_LOW_BAT_ACT|BAT_(LOW|CRIT|EMERGEN)_THR",
    "failsafe": r"FS_\w+|THR_FAILSAFE|THR_FS_VALUE|AFS_\w+|CHUTE_\w+|RTL_ALT\w*|RTL_(RETURN|DESCEND)_ALT"
    r"|NAV_(DLL|RCL)_ACT|COM_\w+_(ACT|LOSS_T)|COM_FAIL_ACT_T|COM_POS\w+|COM_RCL_EXCEPT|COM_KILL_DISARM"
    r"|COM_RC_OVERRIDE|MAN_OVERRIDE_SPD|FD_\w+",
    "geofence": r"FENCE_\w+|GF_\w+",
    "identity on the link": r"SYSID_\w+|MAV_SYSID|MAV_GCS_SYSID\w*|MAV_(SYS|COMP)_ID",
}
_SAFETY = {kind: re.compile(pattern) for kind, pattern in _KINDS.items()}
_OWN = re.compile(
    r"STAT_\w+|(MIS|FENCE|RALLY)_TOTAL|BARO\d*_GND_PRESS|FORMAT_VERSION|SYS_NUM_RESETS|LND_FLIGHT_T_(HI|LO)"
    r"|COM_FLIGHT_UUID|_HASH_CHECK"
)
"""MIS_TOTAL and the like count stored items, home included: setting one cuts the list."""


def safety_kind(name: str) -> str:
    """Return what of a vehicle's safety a parameter belongs to, such as `geofence`; empty if it belongs to nothing."""
    return next((kind for kind, pattern in _SAFETY.items() if pattern.fullmatch(name)), "")


def is_vehicles_own(name: str) -> bool:
    """Whether the vehicle changes a parameter by itself: a counter or measurement, which is not to be set."""
    return _OWN.fullmatch(name) is not None
