"""What a manifest may say to the MAVLink driver: what it does not know is told at its line, with what there is."""

import pytest

from bridged.drivers.mavlink.action_binding import CALLS, COMMANDS, MESSAGES
from bridged.drivers.registry import check_manifest
from schemas.files.findings import Findings
from schemas.manifest.loader import read_manifest

ROBOT = '[robot]\ndriver = "mavlink"\nvehicle = "copter"\n'
CALL_NAMES, COMMAND_NAMES = ", ".join(CALLS), ", ".join(COMMANDS)


def problems(text: str) -> list[str]:
    try:
        found = check_manifest(read_manifest(ROBOT + text, "m.toml"))
    except Findings as findings:
        found = findings.findings
    return [f"{one.line}: {one.message}" for one in found]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '[actions.a]\ncall = "mission_fly"\n',
            [f"5: actions.a.call: the driver has no call `mission_fly`; it has {CALL_NAMES}"],
        ),
        (
            '[actions.a]\nparams = [{name = "points", type = "list"}]\ncall = "mission_upload"\n',
            [
                "5: actions.a.params: mission_upload is given items, home_first, got `points`",
                "5: actions.a.params: mission_upload needs `items`",
            ],
        ),
        (
            '[actions.a]\nparams = [{name = "v"}]\ncall = "param_set"\nfields = {value = "v"}\n',
            ["7: actions.a.fields: param_set needs `name`"],
        ),
        (
            '[actions.a]\ncall = "mission_clear"\nconfirm = "ack"\n',
            ["6: actions.a.confirm: mission_clear takes no `confirm`: it confirms itself, got `ack`"],
        ),
        (
            '[actions.a]\nparams = [{name = "command", type = "int"}]\ncall = "command"\n',
            ["4: actions.a.confirm: command takes `ack`, got ``"],
        ),
        (
            '[actions.a]\nmessage = "SET_POSITION_TARGET_LOCAL_NED"\nframe = "relative"\nconfirm = "velocity"\n'
            "fields = {vx = 1, w = 2}\n",
            [
                "6: actions.a.frame: SET_POSITION_TARGET_LOCAL_NED has the frames local, body, got `relative`",
                "8: actions.a.fields: no field `w`, there is x, y, z, vx, vy, vz, yaw, yaw_rate",
                "8: actions.a.fields: `vy` is missing",
            ],
        ),
        (
            '[actions.a]\nmessage = "SET_POSITION_TARGET_GLOBAL_INT"\nframe = "relative"\nconfirm = "landed"\n'
            "fields = {lat_int = 1, lon_int = 2, alt = 3}\n",
            ["7: actions.a.confirm: SET_POSITION_TARGET_GLOBAL_INT is confirmed by target, arrival, got `landed`"],
        ),
        (
            '[actions.a]\nmessage = "RC_CHANNELS_OVERRIDE"\nconfirm = "rc"\n',
            ["4: actions.a.fields: no channel is given"],
        ),
        (
            '[actions.a]\ncommand = "MAV_CMD_DO_REPOSITION"\nconfirm = "arrival"\n',
            ["5: actions.a.command: MAV_CMD_DO_REPOSITION needs `frame`: relative, amsl"],
        ),
        (
            '[actions.a]\ncommand = "MAV_CMD_DO_SET_SERVO"\nconfirm = "gripper"\n',
            ["6: actions.a.confirm: `gripper` confirms MAV_CMD_DO_GRIPPER, not MAV_CMD_DO_SET_SERVO"],
        ),
        (
            '[actions.a]\ncommand = "MAV_CMD_NAV_LAND"\nconfirm = "landed"\nfeedback = ["altitude", "mood"]\n',
            ["7: actions.a.feedback: `mood` is not reported; there is altitude, distance"],
        ),
        (
            '[actions.a]\ncommand = "MAV_CMD_DO_GRIPPER"\nconfirm = "gripper"\nfeedback = ["pwm"]\n',
            ["7: actions.a.feedback: `pwm` is not reported; there is none"],
        ),
        (
            '[actions.a]\ntopic = "cmd_vel"\n',
            ["5: actions.a.topic: the mavlink driver acts by `command`, `message`, `call`"],
        ),
        (
            '[percepts.p]\nsource = "PARAM"\nargs = ["name", "kind"]\n',
            ["6: percepts.p.args: PARAM has no field `kind`, it has name, value"],
        ),
    ],
)
def test_what_the_driver_does_not_know_is_told_at_its_line_with_what_there_is(text: str, said: list[str]) -> None:
    assert problems(text) == said


def test_every_confirmation_of_a_message_says_which_fields_it_cannot_do_without() -> None:
    for message in MESSAGES.values():
        for confirm, needed in message.needed.items():
            assert confirm in message.confirm
            assert set(needed) <= set(message.fields)


def test_every_call_needs_only_what_it_is_given() -> None:
    for call in CALLS.values():
        assert set(call.needed) <= set(call.fields)
