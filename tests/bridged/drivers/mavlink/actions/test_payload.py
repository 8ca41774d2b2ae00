"""Camera, gimbal, winch and relays: each action is confirmed by what the equipment reports."""

import math
from pathlib import Path

import msgspec
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.payload import Payload
from schemas.manifest.loader import PerceptEntry, load_manifest
from schemas.wire.records import ActionStatus
from schemas.wire.terms import Term
from tests.bridged.components import CAMERA, CameraComponent, GimbalComponent
from tests.bridged.sky import HOME, Message, Sky, end_of, is_ack_of, is_command

COPTER = load_manifest("copter")
STATION = (255, 190)


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    sky = Sky(tmp_path)
    sky.forward(lambda: sky.belief("home_pos"), "the vehicle's home")
    return sky


@pytest.fixture
def camera(sky: Sky) -> CameraComponent:
    camera = CameraComponent()
    sky.components.append(camera)
    return camera


@pytest.fixture
def gimbal(sky: Sky) -> GimbalComponent:
    gimbal = GimbalComponent()
    sky.components.append(gimbal)
    sky.wait(1)
    return gimbal


def carried(sky: Sky) -> Payload:
    """What is attached to the autopilot."""
    return sky.vehicle.autopilot.payload


def without(sky: Sky, name: str) -> None:
    """The vehicle refuses requests for a message, and never sends it."""
    number = getattr(dialect, f"MAVLINK_MSG_ID_{name}")

    def hears(message: Message) -> bool:
        if not (is_command(dialect.MAV_CMD_REQUEST_MESSAGE)(message) and message.param1 == number):
            return True
        ack = dialect.MAVLink_command_ack_message(message.command, dialect.MAV_RESULT_DENIED, 0, 0, 1, 191)
        sky.downlink.append(ack)
        return False

    sky.hears_us = hears


def succeeded(status: ActionStatus) -> bool:
    assert status.state == "succeeded", status.reason
    return True


# Relays


def test_a_relay_is_switched_when_the_vehicle_shows_it(sky: Sky) -> None:
    sky.done("set_relay", 2, True)
    assert carried(sky).relays == 0b100
    sky.done("set_relay", 2, False)
    assert carried(sky).relays == 0


def test_a_vehicle_that_does_not_report_its_relays_is_believed_its_acknowledgement(sky: Sky) -> None:
    without(sky, "RELAY_STATUS")
    sky.done("set_relay", 2, True)
    assert carried(sky).relays == 0b100


# Winch


def test_a_winch_lets_out_and_winds_in_as_much_line(sky: Sky) -> None:
    heard = sky.begin("winch", 5)
    assert 5 <= sky.forward(lambda: heard[-1].final, "the winch") < 7
    assert succeeded(heard[-1])
    assert carried(sky).winch.goal == 5
    sky.done("winch", -2)
    assert carried(sky).winch.goal == 3


def test_a_winch_that_stops_early_fails_with_where_it_is(sky: Sky) -> None:
    assert end_of(sky.do("winch", -3)) == ("failed", "the winch stopped with 0.0 m of line out instead of -3.0 m")


def test_a_lost_acknowledgement_lets_no_line_out_twice(sky: Sky) -> None:
    sky.we_hear = lambda message: not is_ack_of(dialect.MAV_CMD_DO_WINCH)(message)
    sky.done("winch", 4)
    assert carried(sky).winch.goal == 4
    assert len(sky.commands(dialect.MAV_CMD_DO_WINCH)) == 1


# A camera that is attached to the autopilot


def test_a_camera_of_the_autopilot_has_taken_a_picture_when_it_says_that_it_triggered(sky: Sky) -> None:
    sky.done("take_picture")
    assert carried(sky).pictures == 1


@pytest.mark.parametrize("answers", [True, False], ids=["refuses", "is silent"])
def test_an_autopilot_that_knows_no_pictures_is_triggered(sky: Sky, answers: bool) -> None:
    asked = is_command(dialect.MAV_CMD_IMAGE_START_CAPTURE)
    sky.pretend(asked, dialect.MAV_RESULT_UNSUPPORTED)
    if not answers:
        sky.hears_us = lambda message: not asked(message)
    sky.done("take_picture")
    assert len(sky.commands(dialect.MAV_CMD_DO_DIGICAM_CONTROL)) == 1
    assert carried(sky).pictures == 1


def test_a_camera_that_cannot_is_not_triggered_otherwise(sky: Sky) -> None:
    sky.pretend(is_command(dialect.MAV_CMD_IMAGE_START_CAPTURE), dialect.MAV_RESULT_FAILED, "camera not ready")
    status = sky.do("take_picture")
    assert (status.state, "camera not ready" in status.reason) == ("refused", True)
    assert sky.commands(dialect.MAV_CMD_DO_DIGICAM_CONTROL) == []


# A camera that is a component


def test_a_heartbeat_of_a_camera_is_not_the_vehicles(sky: Sky, camera: CameraComponent) -> None:
    before = sky.belief("state")
    sky.wait(5)
    assert sky.belief("state") == before
    sky.we_hear = lambda message: message.get_srcComponent() == CAMERA
    sky.forward(lambda: not sky.driver.heard, "the loss of the vehicle", within=10)


def test_a_camera_takes_the_picture_and_the_autopilot_is_not_asked(sky: Sky, camera: CameraComponent) -> None:
    sky.done("take_picture")
    assert (camera.pictures, carried(sky).pictures) == (4, 0)


def test_a_camera_is_awaited_after_the_vehicle(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.forward(lambda: sky.driver.heard, "the vehicle")
    heard = sky.begin("take_picture")
    sky.wait(1)
    camera = CameraComponent()
    sky.components.append(camera)
    sky.end(heard)
    assert (heard[-1].state, camera.pictures) == ("succeeded", 4)


@pytest.mark.parametrize("way", ["announces", "counts"])
def test_a_camera_that_only_counts_or_only_announces_has_taken_it(sky: Sky, camera: CameraComponent, way: str) -> None:
    setattr(camera, way, False)
    sky.done("take_picture")


def test_a_lost_acknowledgement_takes_one_picture(sky: Sky, camera: CameraComponent) -> None:
    camera.acknowledges, camera.announces = False, False
    sky.done("take_picture")
    sky.done("take_picture")
    assert camera.pictures == 5


def test_a_picture_of_before_proves_nothing(sky: Sky, camera: CameraComponent) -> None:
    camera.obeys = False
    heard = sky.begin("take_picture")
    sky.wait(2)
    camera.outbox.append(camera._captured())
    sky.end(heard)
    assert (heard[-1].state, "no picture is reported" in heard[-1].reason) == ("failed", True)


def test_a_camera_that_fails_fails_the_action(sky: Sky, camera: CameraComponent) -> None:
    camera.works = False
    camera.pictures += 1  # so that the picture that failed has a new index
    camera.counts = False
    assert end_of(sky.do("take_picture")) == ("failed", "the camera reports that it could not take the picture")
    assert sky.commands(dialect.MAV_CMD_DO_DIGICAM_CONTROL) == []


def test_cameras_are_told_apart(sky: Sky, camera: CameraComponent) -> None:
    second = CameraComponent(CAMERA + 1)
    sky.components.append(second)
    sky.wait(1)
    sky.done("take_picture", CAMERA + 1)
    assert (camera.pictures, second.pictures) == (3, 4)
    sky.done("take_picture", 1)
    assert carried(sky).pictures == 1
    status = sky.do("take_picture", CAMERA + 2)
    assert (status.state, status.reason) == (
        "refused", "no camera is heard as component 102 of the vehicle; heard: 100, 101"
    )  # fmt: skip


def test_video_mode_and_zoom_are_shown_by_the_camera(sky: Sky, camera: CameraComponent) -> None:
    sky.done("start_video")
    assert camera.video
    sky.done("stop_video")
    assert not camera.video
    sky.done("set_camera_mode", 2)
    sky.done("zoom", 40)
    assert (camera.mode, camera.zoom) == (2, 40)


def test_a_video_that_does_not_start_fails(sky: Sky, camera: CameraComponent) -> None:
    camera.obeys = False
    status = sky.do("start_video")
    assert status.state == "failed"
    assert "CAMERA_CAPTURE_STATUS does not show a video that is recorded" in status.reason


def test_a_camera_does_not_answer_for_the_autopilot(sky: Sky, camera: CameraComponent) -> None:
    sky.hears_us = lambda message: not is_command(dialect.MAV_CMD_DO_SET_RELAY)(message)
    without_relays = sky.hears_us
    sky.hears_us = lambda message: without_relays(message) and not is_command(dialect.MAV_CMD_REQUEST_MESSAGE)(message)
    heard = sky.begin("set_relay", 1, True)
    sky.wait(0.5)
    ack = dialect.MAVLink_command_ack_message(dialect.MAV_CMD_DO_SET_RELAY, 0, 0, 0, 1, 191)
    camera.outbox.append(ack)
    sky.end(heard)
    assert (heard[-1].state, heard[-1].reason.startswith("no acknowledgement of")) == ("failed", True)


# Gimbals


def test_a_gimbal_points_when_its_attitude_shows_it(sky: Sky) -> None:
    heard = sky.begin("point_gimbal", -45, 30)
    assert sky.forward(lambda: heard[-1].final, "the gimbal") >= 0.7  # 60 degrees a second
    assert succeeded(heard[-1])
    gimbal, ours = carried(sky).gimbal, sky.driver.identity
    assert math.degrees(gimbal.pitch.goal) == pytest.approx(-45)
    assert math.degrees(gimbal.yaw.goal) == pytest.approx(30)
    assert gimbal.by == (ours.system, ours.component)


def test_a_gimbal_that_looks_straight_down_has_no_yaw_to_be_near(sky: Sky) -> None:
    sky.done("point_gimbal", -90, 77)


def test_control_is_claimed_from_others(sky: Sky) -> None:
    carried(sky).gimbal.by = STATION
    sky.done("point_gimbal", 0, 90)


def test_control_that_is_not_given_is_a_refusal_that_says_who_has_it(sky: Sky, gimbal: GimbalComponent) -> None:
    gimbal.gimbal.by, gimbal.gives_control = STATION, False
    without(sky, "GIMBAL_MANAGER_STATUS")
    status = sky.do("point_gimbal", 0, 90)
    assert status.state == "refused"
    assert status.reason.startswith("system 255 component 190 is in control of the gimbal, and it did not give")


def test_control_that_is_acknowledged_and_not_given_is_a_refusal(sky: Sky) -> None:
    carried(sky).gimbal.by = STATION
    sky.pretend(is_command(dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE))
    status = sky.do("point_gimbal", 0, 90)
    assert (status.state, status.reason.endswith("though it acknowledged that")) == ("refused", True)


def test_a_gimbal_that_another_takes_fails_at_once(sky: Sky) -> None:
    sky.pretend(is_command(dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW))
    heard = sky.begin("point_gimbal", 0, 90)
    sky.wait(1)
    carried(sky).gimbal.by = STATION
    sky.downlink.append(carried(sky).gimbal.status(0))
    sky.wait(0.1)
    assert heard[-1].state == "failed"
    assert heard[-1].reason == "system 255 component 190 took control of the gimbal"


@pytest.mark.parametrize("q", [[0.0] * 4, [math.nan] * 4, [math.nan, 0.0, 0.0, 0.0]], ids=["zeros", "NaN", "one NaN"])
def test_a_gimbal_that_does_not_know_where_it_points_proves_nothing(sky: Sky, q: list[float]) -> None:
    def forgetful(message: Message) -> bool:
        if message.get_type() == "GIMBAL_DEVICE_ATTITUDE_STATUS":
            message.q = q
        return True

    sky.we_hear = forgetful
    status = sky.do("point_gimbal", 0, 0)
    assert (status.state, "but the gimbal does not report where it points" in status.reason) == ("failed", True)


def test_messages_of_a_gimbal_may_be_percepts_and_are_no_late_stream(sky: Sky, gimbal: GimbalComponent) -> None:
    source = PerceptEntry(source="GIMBAL_DEVICE_ATTITUDE_STATUS", args=("q",), rate=1.0)
    manifest = msgspec.structs.replace(COPTER, percepts=COPTER.percepts | {"gimbal": source})
    sky.driver.adopt(manifest)
    sky.bridge.percepts.adopt(manifest)
    sky.we_hear = lambda message: message.get_srcComponent() != 1 or message.get_type() != source.source
    for _ in range(12):
        gimbal.outbox.append(gimbal.gimbal.attitude(HOME, 0.0, 0.0))
        sky.wait(1)
    assert sky.belief("gimbal") == ([1, 0, 0, 0],)
    assert [note for note in sky.driver.notes() if note.code == "message_late"] == []


def test_a_gimbal_that_is_a_component_is_its_own_manager(sky: Sky, gimbal: GimbalComponent) -> None:
    without(sky, "GIMBAL_MANAGER_STATUS")
    sky.done("point_gimbal", 20, -60)
    assert math.degrees(gimbal.gimbal.yaw.goal) == pytest.approx(-60)
    assert carried(sky).gimbal.by == (0, 0)


def test_the_gimbal_follows_a_place(sky: Sky) -> None:
    sky.flying(20)
    sky.done("look_at", -27.603683, -48.518052, 0)
    north, east = (-27.603683 + 27.604033) * 111_319.5, (-48.518052 + 48.518363) * 111_319.5 * math.cos(0.4818)
    pitch = math.degrees(carried(sky).gimbal.pitch.goal)
    assert pitch == pytest.approx(-math.degrees(math.atan2(20, math.hypot(north, east))), abs=2)
    sky.done("goto", -27.603683, -48.518052, 20)
    sky.vehicle.receive(
        dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_REQUEST_MESSAGE, 0, 285, 0, 0, 0, 0, 0, 0)
    )
    assert math.degrees(carried(sky).gimbal.pitch.goal) < -80
    sky.done("look_nowhere")
    assert carried(sky).gimbal.looks_at is None


@pytest.mark.parametrize(
    ("command", "action", "reason"),
    [
        (dialect.MAV_CMD_DO_SET_RELAY, ("set_relay", 2, True), "RELAY_STATUS does not show relay 2 on"),
        (dialect.MAV_CMD_DO_SET_RELAY, ("set_relay", 9, True), "RELAY_STATUS shows no relay 9"),
        (dialect.MAV_CMD_IMAGE_START_CAPTURE, ("take_picture",), "no picture is reported"),
        (
            dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
            ("point_gimbal", -30, 90),
            "but it points to pitch 0, yaw 0 degrees",
        ),
        (dialect.MAV_CMD_DO_SET_ROI_LOCATION, ("look_at", -27.603683, -48.518052, 0), "but it points to"),
    ],
    ids=["a relay", "a relay that is not there", "a picture", "a gimbal", "a gimbal that is to follow"],
)
def test_what_is_acknowledged_and_not_shown_fails(
    sky: Sky, command: int, action: tuple[str, *tuple[Term, ...]], reason: str
) -> None:
    sky.flying(20)
    sky.pretend(lambda message: getattr(message, "command", 0) == command)
    status = sky.do(*action)
    assert (status.state, reason in status.reason) == ("failed", True), status.reason


@pytest.mark.parametrize(
    ("message", "action", "said"),
    [
        ("WINCH_STATUS", ("winch", 4), "has it one?"),
        ("GIMBAL_MANAGER_STATUS", ("point_gimbal", -30, 90), "no gimbal manager answers; has it a gimbal?"),
    ],
)
def test_a_vehicle_without_the_equipment_says_so(
    sky: Sky, message: str, action: tuple[str, *tuple[Term, ...]], said: str
) -> None:
    without(sky, message)
    status = sky.do(*action)
    assert (status.state, said in status.reason) == ("failed", True)
    assert sky.commands(dialect.MAV_CMD_DO_WINCH) == []
