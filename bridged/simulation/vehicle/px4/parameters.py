"""Parameters of the simulated PX4: names and values of the recorded vehicles, for what is simulated or used."""

import struct
from collections.abc import Mapping

from bridged.simulation.vehicle.parameters import Kind, Row

NO_SUCH, WRONG_TYPE = 1, 7
"""error of PARAM_ERROR (MAV_PARAM_ERROR)."""

_I, _F = Kind.INT32, Kind.REAL32

OUTPUTS = 16
"""MAIN outputs; there is no AUX (recorded)."""
_OF_AN_OUTPUT = {"FUNC": 0, "MIN": 1000, "MAX": 2000, "DIS": 900}
"""Parameters of each output, and their values."""

COMMON: Mapping[str, tuple[float, Kind]] = {
    "BAT1_A_PER_V": (36.4, _F),
    "BAT1_CAPACITY": (-1, _F),
    "BAT1_N_CELLS": (4, _I),
    "BAT_CRIT_THR": (0.07, _F),
    "BAT_EMERGEN_THR": (0.05, _F),
    "BAT_LOW_THR": (0.15, _F),
    "COM_DISARM_LAND": (2, _F),
    "COM_DISARM_PRFLT": (10, _F),
    "COM_DL_LOSS_T": (10, _I),
    "COM_FAIL_ACT_T": (5, _F),
    "COM_LOW_BAT_ACT": (3, _I),
    "COM_OBL_RC_ACT": (0, _I),
    "COM_OF_LOSS_T": (1, _F),
    "COM_POS_LOW_ACT": (3, _I),
    "COM_PREARM_MODE": (0, _I),
    "COM_RC_IN_MODE": (1, _I),
    "COM_RC_LOSS_T": (0.5, _F),
    "GF_ACTION": (2, _I),
    "GF_MAX_HOR_DIST": (0, _F),
    "GF_MAX_VER_DIST": (0, _F),
    "MAN_OVERRIDE_SPD": (1, _F),
    "MAV_SYS_ID": (1, _I),
    "MIS_TAKEOFF_ALT": (2.5, _F),
    "NAV_ACC_RAD": (10, _F),
    "NAV_DLL_ACT": (0, _I),
    "NAV_LOITER_RAD": (80, _F),
    "NAV_RCL_ACT": (2, _I),
    "RTL_LOITER_RAD": (80, _F),
    "RTL_MIN_DIST": (10, _F),
    "RTL_RETURN_ALT": (30, _F),
    "RTL_TYPE": (0, _I),
    "SIM_BAT_DRAIN": (60, _F),
    "SIM_BAT_MIN_PCT": (50, _F),
    "SYS_AUTOSTART": (10040, _I),
    "SYS_FAILURE_EN": (1, _I),
    "PWM_MAIN_REV": (0, _I),
    **{
        f"PWM_MAIN_{what}{output}": (value, _I)
        for output in range(1, OUTPUTS + 1)
        for what, value in _OF_AN_OUTPUT.items()
    },
}
"""Of every kind of vehicle."""

COPTER: Mapping[str, tuple[float, Kind]] = {
    **{f"PWM_MAIN_FUNC{motor}": (100 + motor, _I) for motor in range(1, 5)},
    "MPC_ACC_HOR": (3, _F),
    "MPC_LAND_ALT1": (10, _F),
    "MPC_LAND_ALT2": (5, _F),
    "MPC_LAND_SPEED": (0.7, _F),
    "MPC_TKO_SPEED": (1.5, _F),
    "MPC_VEL_MANUAL": (10, _F),
    "MPC_XY_CRUISE": (5, _F),
    "MPC_XY_VEL_MAX": (12, _F),
    "MPC_Z_V_AUTO_DN": (1.5, _F),
    "MPC_Z_V_AUTO_UP": (3, _F),
}


PLANE: Mapping[str, tuple[float, Kind]] = {
    "FW_AIRSPD_MAX": (20, _F),
    "FW_AIRSPD_MIN": (10, _F),
    "FW_AIRSPD_TRIM": (15, _F),
    "FW_LND_ANG": (5, _F),
    "MIS_TAKEOFF_ALT": (25, _F),
    "RTL_RETURN_ALT": (100, _F),
    "RTL_TYPE": (1, _I),
    "RWTO_TKOFF": (1, _I),
}

ROVER: Mapping[str, tuple[float, Kind]] = {
    "NAV_ACC_RAD": (0.5, _F),
    "RO_SPEED_LIM": (3, _F),
    "RTL_RETURN_ALT": (60, _F),
}


def rows(own: Mapping[str, tuple[float, Kind]]) -> list[Row]:
    """Return the parameters of a kind of vehicle in PX4's order, by name; its own override the common ones."""
    return sorted((name, default, kind) for name, (default, kind) in {**COMMON, **own}.items())


def encoded(value: float, kind: Kind) -> float:
    """Return param_value of a PARAM_VALUE: an integer as a float of the same bytes."""
    if kind is Kind.REAL32:
        return value
    (number,) = struct.unpack("<f", struct.pack("<i", int(value)))
    return float(number)


def decoded(value: float, kind: int) -> float:
    """Return the number in param_value of a PARAM_SET: an integer by its bytes."""
    if kind != Kind.INT32:
        return value
    (number,) = struct.unpack("<i", struct.pack("<f", value))
    return float(number)
