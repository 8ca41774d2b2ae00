"""Parameter files: what ground stations write is read, what is written they read, and a vehicle is compared with it."""

import struct
from pathlib import Path

import pytest
from pymavlink import mavparm

from argosy.params.param_files import compare, read_parameter_file, same_value, value_text, write_parameters
from bridged.drivers.mavlink.vehicle.safety_parameters import is_vehicles_own, safety_kind
from schemas.files.findings import Findings

MISSION_PLANNER = "#NOTE: 2026-11-01 Quad\r\nRTL_ALT,1500\r\nWPNAV_RADIUS,200.5\r\nATC_RAT_RLL_P,0.135\r\n"
MAVPROXY = "RTL_ALT          1500.000000\nWPNAV_RADIUS     200.500000\nATC_RAT_RLL_P    0.135000\n"
QGROUNDCONTROL = """\
# Onboard parameters for Vehicle 1
#
# Vehicle-Id Component-Id Name Value Type
1\t1\tRTL_ALT\t1500\t6
1\t1\tWPNAV_RADIUS\t200.500000000000000000\t9
1\t1\tATC_RAT_RLL_P\t0.135000005364418030\t9
1\t100\tCAM_MODE\t1\t6
"""


@pytest.mark.parametrize(
    ("text", "others"), [(MISSION_PLANNER, 0), (MAVPROXY, 0), (QGROUNDCONTROL, 1)], ids=["mp", "mavproxy", "qgc"]
)
def test_the_files_of_three_ground_stations_hold_the_same(tmp_path: Path, text: str, others: int) -> None:
    (tmp_path / "p.param").write_bytes(text.encode())
    file = read_parameter_file(tmp_path / "p.param")
    assert file.of_others == others
    held = {"RTL_ALT": 1500.0, "WPNAV_RADIUS": 200.5, "ATC_RAT_RLL_P": float32(0.135), "MORE": 1.0}
    found = compare(file.values, held)
    assert (found.differences, found.unknown, found.same, found.not_in_file) == ((), (), 3, 1)


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("RTL_ALT,high\n", 1, "RTL_ALT: expected a number, got `high`"),
        ("A,1\nRTL_ALT,nan\n", 2, "RTL_ALT: expected a number"),
        ("RTL_ALT,1e39\n", 1, "RTL_ALT: expected a number"),
        ("RTL_ALT\n", 1, "expected NAME,VALUE or a row of QGroundControl's table, got `RTL_ALT`"),
        ("A_NAME_THAT_IS_TOO_LONG,1\n", 1, "expected the name of a parameter, of at most 16 characters"),
        ("A,1\nB,2\nA,2\n", 3, "A again, with another value than 1"),
        ("# nothing\n", 0, "expected parameters"),
    ],
)
def test_a_wrong_line_is_told_by_its_number(tmp_path: Path, text: str, line: int, said: str) -> None:
    (tmp_path / "p.param").write_text(text)
    with pytest.raises(Findings) as found:
        read_parameter_file(tmp_path / "p.param")
    assert found.value.findings[0].line == line
    assert said in found.value.findings[0].message


def test_what_is_written_is_read_by_pymavlink_and_again_with_the_same_bits(tmp_path: Path) -> None:
    values = {f"P{index}": float32(value) for index, value in enumerate(VALUES)} | {"BITS": 2.0**31 + 1}
    path = tmp_path / "p.param"
    path.write_text(write_parameters(values, ["of a test"]))
    theirs = mavparm.MAVParmDict()
    assert theirs.load(str(path), check=False)
    ours = read_parameter_file(path).values
    for name, value in values.items():
        assert (float32(ours[name]), float32(theirs[name])) == (float32(value), float32(value)), name
    assert ours["BITS"] == values["BITS"], "whole numbers of PX4 have more bits than a float of 32"


VALUES = [
    0.0,
    1.0,
    -1.0,
    0.135,
    1e-7,
    1 / 3,
    16777217.0,
    3.4e38,
    -123456.79,
    0.1 + 0.2,
    *(1.0001**n for n in range(500)),
]


def test_values_are_compared_as_a_vehicle_keeps_them() -> None:
    assert same_value(float32(0.135), 0.135)
    assert same_value(float32(0.1234567), 0.123457), "MAVProxy writes six decimals"
    assert not same_value(16777217.0, 16777219.0)
    assert not same_value(1.4, 1.0)
    assert not same_value(0.001, 0.0011)
    assert value_text(float32(0.135)) == "0.135"
    assert value_text(2.0**31) == "2147483648"


def test_renamed_parameters_are_found_and_the_vehicles_own_are_not_set() -> None:
    wanted = {"SYSID_MYGCS": 254.0, "STAT_RUNTIME": 5.0, "MIS_TOTAL": 7.0, "FENCE_ENABLE": 1.0, "NEW_ONE": 1.0}
    held = {"MAV_GCS_SYSID": 255.0, "STAT_RUNTIME": 900.0, "FENCE_ENABLE": 0.0, "MIS_TOTAL": 1.0}
    found = compare(wanted, held)
    assert [(one.name, one.held, one.safety) for one in found.differences] == [
        ("SYSID_MYGCS", 255.0, "identity on the link"),
        ("FENCE_ENABLE", 0.0, "geofence"),
    ]
    assert (found.unknown, found.own, found.same) == (("NEW_ONE",), 2, 0)


def test_an_unknown_parameter_is_told_with_the_vehicles_that_it_nearly_is() -> None:
    found = compare({"RTL_ALTT": 1500.0, "ZZZ": 1.0}, {"RTL_ALT": 1500.0, "FENCE_ENABLE": 0.0})
    assert "does not have: RTL_ALTT (did you mean `RTL_ALT`?) and ZZZ;" in found.text("uav1")


def test_a_file_of_another_kind_of_vehicle_is_told_in_a_line_that_can_be_read() -> None:
    found = compare({f"P{index}": 1.0 for index in range(900)}, {"Q": 1.0})
    assert len(found.text("uav1").splitlines()) == 1
    assert "900 that the vehicle does not have: P0, P1," in found.text("uav1")
    assert "P19 and 880 more; 1 of the vehicle" in found.text("uav1")


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("arming", "ARMING_CHECK ARMING_SKIPCHK BRD_SAFETY_DEFLT COM_ARM_WO_GPS COM_PREARM_MODE CBRK_FLIGHTTERM"),
        ("failsafe", "FS_GCS_ENABLE FS_THR_ENABLE FS_EKF_ACTION THR_FAILSAFE AFS_ENABLE NAV_DLL_ACT NAV_RCL_ACT"),
        ("failsafe", "COM_OBL_RC_ACT COM_DL_LOSS_T COM_FAIL_ACT_T COM_QC_ACT RTL_ALT RTL_RETURN_ALT FD_FAIL_P"),
        ("battery failsafe", "BATT_FS_LOW_ACT BATT2_CRT_VOLT BATT_LOW_MAH COM_LOW_BAT_ACT BAT_CRIT_THR"),
        ("geofence", "FENCE_ENABLE FENCE_RADIUS GF_ACTION GF_MAX_HOR_DIST"),
        ("identity on the link", "MAV_SYSID SYSID_THISMAV MAV_SYS_ID MAV_GCS_SYSID"),
        ("", "WPNAV_SPEED ATC_RAT_RLL_P MPC_XY_CRUISE BATT_CAPACITY SERVO9_FUNCTION"),
    ],
)
def test_safety_parameters_of_ardupilot_and_px4_are_known_by_name(kind: str, names: str) -> None:
    for name in names.split():
        assert safety_kind(name) == kind, name
        assert not is_vehicles_own(name)


def float32(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])
