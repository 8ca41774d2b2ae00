"""Parameters by name: what the vehicle tells that it has is the proof, and a name that it does not know is told."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.parameters import spellings
from bridged.simulation.vehicle.fault_injection import Faults
from schemas.wire.terms import Term
from tests.bridged.sky import MISSION, Message, Sky, end_of, is_command


def told(sky: Sky) -> dict[Term, Term]:
    found = sky.beliefs("parameter")
    return {one[0]: one[1] for one in found}


def test_a_parameter_that_is_asked_for_becomes_a_percept(sky: Sky) -> None:
    sky.done("get_param", "RTL_ALT")
    sky.done("get_param", "FENCE_RADIUS")
    assert told(sky) == {"RTL_ALT": 1500, "FENCE_RADIUS": 300}


def test_a_parameter_is_set_when_the_vehicle_tells_that_value(sky: Sky) -> None:
    sky.done("set_param", "RTL_ALT", 2000)
    assert sky.vehicle.autopilot.parameters["RTL_ALT"] == 2000
    assert told(sky) == {"RTL_ALT": 2000}


def test_a_value_that_the_vehicle_did_not_take_fails_with_both_numbers(sky: Sky) -> None:
    final = sky.do("set_param", "FENCE_TYPE", 1000)
    assert (final.state, final.reason) == ("failed", "FENCE_TYPE: 1000 was asked for, the vehicle has 127")
    assert told(sky) == {"FENCE_TYPE": 127}


def test_a_fraction_is_compared_as_the_vehicle_stores_it(sky: Sky) -> None:
    sky.done("set_param", "MOT_THST_HOVER", 0.21)


@pytest.mark.parametrize(("name", "arguments"), [("get_param", ()), ("set_param", (3,))])
def test_a_name_the_vehicle_does_not_know_is_told_after_3_s(sky: Sky, name: str, arguments: tuple[int, ...]) -> None:
    sky.wait(1)
    assert end_of(sky.do(name, "NO_SUCH", *arguments)) == ("failed", "the vehicle knows no parameter NO_SUCH")
    asked = [one for one in sky.sent if one.get_type() == "PARAM_REQUEST_READ" and one.param_id == "NO_SUCH"]
    assert len(asked) == 6


def test_a_parameter_is_known_under_its_older_name_too(sky: Sky) -> None:
    sky.done("set_param", "SYSID_MYGCS", 250)
    assert sky.vehicle.autopilot.parameters["MAV_GCS_SYSID"] == 250
    assert told(sky) == {"SYSID_MYGCS": 250}


@pytest.mark.parametrize(
    ("name", "all_of_them"),
    [
        ("RTL_ALT", ("RTL_ALT",)),
        ("SYSID_THISMAV", ("SYSID_THISMAV", "MAV_SYSID")),
        ("MAV_GCS_SYSID", ("MAV_GCS_SYSID", "SYSID_MYGCS")),
        ("SR0_POSITION", ("SR0_POSITION", "MAV1_POSITION")),
        ("MAV2_EXTRA1", ("MAV2_EXTRA1", "SR1_EXTRA1")),
        ("MAV0_EXTRA1", ("MAV0_EXTRA1",)),
        ("SRTL_ACCURACY", ("SRTL_ACCURACY",)),
    ],
)
def test_both_spellings_of_a_name_are_asked_for(name: str, all_of_them: tuple[str, ...]) -> None:
    assert spellings(name) == all_of_them


def test_a_parameter_is_set_over_a_link_that_loses_every_third_message(sky: Sky) -> None:
    sky.wait(1)
    odd = {"up": 0, "down": 0}

    def lossy(way: str) -> object:
        def passes(message: Message) -> bool:
            if not message.get_type().startswith("PARAM"):
                return True
            odd[way] += 1
            return odd[way] % 3 != 0

        return passes

    sky.hears_us, sky.we_hear = lossy("up"), lossy("down")  # type: ignore[assignment]
    sky.done("set_param", "RTL_ALT", 2000)


def test_a_vehicle_that_never_takes_the_value_fails(sky: Sky) -> None:
    sky.hears_us = lambda message: message.get_type() != "PARAM_SET"
    final = sky.do("set_param", "RTL_ALT", 2000)
    assert (final.state, final.reason) == ("failed", "RTL_ALT: 2000 was asked for, the vehicle has 1500")


def test_a_parameter_that_others_set_later_is_told_again(sky: Sky) -> None:
    sky.do("get_param", "RTL_ALT")
    sky.vehicle.receive(
        _from_others(dialect.MAVLink_param_set_message(1, 1, b"RTL_ALT", 3000.0, dialect.MAV_PARAM_TYPE_REAL32))
    )
    for message in sky.vehicle.receive(_from_others(dialect.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1))):
        sky.downlink.append(message)
    sky.wait(0.1)
    assert told(sky) == {"RTL_ALT": 3000}


def test_a_vehicle_that_says_nothing_after_the_change_is_not_said_to_have_the_old_value(sky: Sky) -> None:
    sky.wait(1)
    answers = iter([True])
    sky.we_hear = lambda message: message.get_type() != "PARAM_VALUE" or next(answers, False)
    final = sky.do("set_param", "RTL_ALT", 2000)
    said = "RTL_ALT: 2000 was asked for, and the vehicle does not report its value"
    assert (final.state, final.reason) == ("failed", said)


def test_the_fence_is_shaped_by_parameters_and_switched_by_a_command(sky: Sky) -> None:
    parameters = sky.vehicle.autopilot.parameters
    sky.done("fence_radius", 120)
    sky.done("fence_altitude", 45)
    assert (parameters["FENCE_RADIUS"], parameters["FENCE_ALT_MAX"]) == (120, 45)
    sky.done("enable_fence", True)
    assert parameters["FENCE_ENABLE"] == 1
    sky.done("enable_fence", False)
    assert parameters["FENCE_ENABLE"] == 0


def test_a_fence_that_is_acknowledged_and_stays_off_is_no_success(sky: Sky) -> None:
    sky.wait(2)
    sky.pretend(is_command(dialect.MAV_CMD_DO_FENCE_ENABLE))
    final = sky.do("enable_fence", True)
    assert final.state == "failed"
    assert final.reason == "MAV_CMD_DO_FENCE_ENABLE was acknowledged, but the fence is not enabled"


def _from_others(message: Message) -> Message:
    from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters

    (back,) = Framer(WireCounters()).feed(Encoder(254, 190).pack(message))
    return back


GUARDED = MISSION + "    failsafe: {gcs: bridge}\n    limits: {altitude: 30}\n"


@pytest.mark.parametrize(
    ("name", "value", "by"),
    [
        ("FS_GCS_ENABLE", 0, "failsafe"),
        ("fs_gcs_enable", 0.4, "failsafe"),
        ("MAV_GCS_SYSID", 250, "failsafe"),
        ("SYSID_MYGCS", 250, "failsafe"),
        ("FS_GCS_TIMEOUT", 1000, "failsafe"),
        ("FENCE_ENABLE", 0, "limits"),
        ("FENCE_ACTION", 0, "limits"),
    ],
)
def test_what_the_mission_needs_is_not_off_by_a_parameter(tmp_path: Path, name: str, value: float, by: str) -> None:
    sky = Sky(tmp_path, mission=GUARDED)
    sky.wait(1)
    final = sky.do("set_param", name, value)
    assert final.state == "refused"
    assert final.reason.startswith(f"{name.upper()} is not set to {value:g}: the mission declares `{by}`")
    assert not any(one.get_type() == "PARAM_SET" for one in sky.sent)


def test_what_the_mission_relies_on_may_be_switched_on(tmp_path: Path) -> None:
    sky = Sky(tmp_path, mission=GUARDED)
    sky.done("set_param", "FS_GCS_ENABLE", 1)
    sky.done("enable_fence", True)
    final = sky.do("enable_fence", False)
    assert final.reason == "FENCE_ENABLE is not set to 0: the mission declares `limits`, and the fence stays as it is"
    assert (final.state, sky.vehicle.autopilot.parameters["FENCE_ENABLE"]) == ("refused", 1)


def test_a_value_that_32_bits_do_not_hold_is_refused(sky: Sky) -> None:
    final = sky.do("set_param", "RTL_ALT", 1e39)
    said = "RTL_ALT: a parameter's value is a number of 32 bits, up to 3.4e38"
    assert (final.state, final.reason) == ("refused", said)


def test_a_fence_is_known_by_what_it_is_although_no_acknowledgement_comes(tmp_path: Path) -> None:
    sky = Sky(tmp_path, faults=Faults.parse(["mute-acks"]))
    for wanted in (True, False):
        assert end_of(sky.do("enable_fence", wanted)) == ("succeeded", "")
        assert sky.vehicle.autopilot.parameters["FENCE_ENABLE"] == wanted


def test_a_fence_whose_bit_is_not_told_is_known_by_its_parameter_without_an_acknowledgement(tmp_path: Path) -> None:
    sky = Sky(tmp_path, faults=Faults.parse(["mute-acks"]))
    sky.wait(1)
    sky.we_hear = lambda message: message.get_type() != "SYS_STATUS"
    assert end_of(sky.do("enable_fence", True)) == ("succeeded", "")
