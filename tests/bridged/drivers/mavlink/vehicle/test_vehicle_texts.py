"""The vehicle's own warnings, in log and percepts, and a restart that is called a restart."""

import logging
from collections.abc import Iterable
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.further_messages import Event
from bridged.drivers.mavlink.vehicle.px4_events import EVENTS
from bridged.drivers.mavlink.vehicle.status_texts import MAX_DISTINCT, StatusText, Texts, Warnings
from bridged.simulation.vehicle.ardupilot.flight_modes import Mode
from bridged.simulation.vehicle.fault_injection import Faults
from bridged.simulation.vehicle.vehicle import Vehicle
from schemas.wire.terms import Atom
from tests.bridged.sky import GOAL, HOME, Message, Sky

WARNING, CRITICAL, INFO = 4, 2, 6


def text(said: str, severity: int = WARNING, number: int = 0, seq: int = 0) -> Message:
    message = dialect.MAVLink_statustext_message(severity, said.encode(), number, seq)
    message.text = said  # as it is decoded
    return message


def warnings(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [record.getMessage() for record in caplog.records if record.levelno == logging.WARNING]


def believed(sky: Sky) -> list[tuple[object, ...]]:
    return sky.beliefs("vehicle_text")


def test_a_battery_failsafe_reaches_log_and_agent_by_itself(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    battery = {"BATT_LOW_VOLT": 12.0, "BATT_LOW_TIMER": 1.0, "BATT_FS_LOW_ACT": 0.0}
    sky = Sky(tmp_path, vehicle=Vehicle(HOME, parameters=battery.items())).flying(10)
    sky.vehicle.autopilot.parameters.set("BATT_FS_LOW_ACT", 2)
    assert not any("Battery" in str(said) for _, said in believed(sky))
    with caplog.at_level(logging.INFO):
        sky.vehicle.autopilot.parameters.set("SIM_BATT_VOLTAGE", 11.0)
        sky.wait(5)
    assert (Atom("warning"), "Battery Failsafe") in believed(sky)
    assert "system 1 says (warning): Battery Failsafe" in warnings(caplog)


def test_what_is_repeated_is_logged_once_and_believed_until_it_is_said_no_more(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sky = Sky(tmp_path)
    sky.wait(5)
    with caplog.at_level(logging.WARNING):
        for _ in range(4):
            sky.downlink.append(text("PreArm: Compass not healthy", CRITICAL))
            sky.wait(30)
            assert believed(sky) == [(Atom("critical"), "PreArm: Compass not healthy")]
        sky.wait(35)
    assert believed(sky) == []
    assert len(warnings(caplog)) == 1
    events = [one.update for agent, one in sky.percepts if one.name == "vehicle_text" and agent == "uav"]
    assert events[-1] == "remove"


def test_information_is_neither_logged_nor_believed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    sky = Sky(tmp_path)
    sky.wait(5)
    with caplog.at_level(logging.WARNING):
        sky.downlink.append(text("EKF3 IMU0 is using GPS", INFO))
        sky.wait(1)
    assert believed(sky) == []
    assert warnings(caplog) == []


def chunks(parts: Iterable[tuple[int, str]], number: int = 7) -> list[StatusText]:
    texts = Texts()
    return [said for seq, part in parts for said in texts.receive(text(part, number=number, seq=seq), 1.0)]


@pytest.mark.parametrize(
    "order", [[(0, "a" * 50), (1, "end\t")], [(1, "end\t"), (0, "a" * 50)], [(0, "a" * 50), (0, "a" * 50), (1, "end")]]
)
def test_the_chunks_of_a_long_text_are_put_together_in_their_order(order: list[tuple[int, str]]) -> None:
    assert chunks(order) == [StatusText(1.0, WARNING, "a" * 50 + "end")]


def test_a_long_text_of_which_a_chunk_is_lost_is_told_when_the_next_one_begins() -> None:
    texts = Texts()
    assert texts.receive(text("a" * 50, number=7, seq=0), 1.0) == []
    assert texts.receive(text("end", number=7, seq=2), 1.0) == []
    said = texts.receive(text("another"), 2.0)
    assert [one.text for one in said] == ["a" * 50 + "...end", "another"]


def test_a_vehicle_that_floods_its_link_with_warnings_is_told_of_so_many_and_the_rest_is_counted() -> None:
    told = Warnings()
    taken = [told.take(StatusText(1.0, WARNING, f"warning {at}"), 60.0) for at in range(3 * MAX_DISTINCT)]
    assert taken.count(True) == MAX_DISTINCT
    assert told.dropped == 2 * MAX_DISTINCT
    assert told.take(StatusText(70.0, WARNING, "later"), 60.0) is True


def rebooted(sky: Sky) -> list[tuple[str, ...]]:
    return sky.told("override")  # type: ignore[misc]


@pytest.mark.parametrize("boot_is_heard", [True, False])
def test_a_vehicle_that_reboots_in_flight_is_called_rebooted_and_nobody_has_taken_control(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, boot_is_heard: bool
) -> None:
    sky = Sky(tmp_path, faults=Faults(reboots=(45.0,))).flying(10)
    heard = sky.begin("goto", GOAL[0] + 0.01, GOAL[1], 20)
    if not boot_is_heard:  # the first HEARTBEATs get lost, as on a line that has to be opened anew
        sky.we_hear = lambda message: message.get_type() != "HEARTBEAT" or message.system_status != 1
    with caplog.at_level(logging.WARNING):
        sky.end(heard, 60)
        sky.wait(3)
    assert (heard[-1].state, heard[-1].reason) == ("failed", "the vehicle rebooted")
    assert "system 1: the vehicle rebooted" in warnings(caplog)
    assert "vehicle_rebooted" in [note.code for note in sky.bridge.health().notes]
    assert rebooted(sky) == []
    assert sky.belief("override") is None
    sky.wait(60)
    assert sky.bridge.health().notes == ()


def test_a_mode_that_is_being_set_when_the_vehicle_reboots_is_not_taken_by_others(tmp_path: Path) -> None:
    sky = Sky(tmp_path, faults=Faults(reboots=(45.0,))).flying(10)
    sky.forward(lambda: sky.vehicle.age > 44.8, "the reboot", 60)
    heard = sky.begin("set_mode", "LOITER")
    assert sky.end(heard, 20).state == "failed"
    sky.wait(5)
    assert sky.driver.vehicle.reboots == 1
    assert sky.told("override") == []


def test_a_pilots_mode_after_a_silence_is_still_a_pilots(tmp_path: Path) -> None:
    sky = Sky(tmp_path).flying(10)
    heard = sky.begin("goto", GOAL[0] + 0.01, GOAL[1], 20)
    sky.wait(2)
    sky.we_hear = lambda message: False
    sky.wait(2.5)
    sky.vehicle.autopilot.set_mode(Mode.LOITER)
    sky.we_hear = lambda message: True
    sky.end(heard, 10)
    assert heard[-1].reason.startswith("the mode became LOITER")
    assert sky.belief("override") == ("LOITER",)
    assert sky.bridge.health().notes == ()


def test_the_first_long_text_of_a_px4_is_joined_though_it_has_the_number_of_short_ones() -> None:
    texts, first = Texts(), "Arming denied: Resolve system health failures firs"
    assert [one.text for one in texts.receive(text(first, CRITICAL), 1.0)] == [first]
    assert [one.text for one in texts.receive(text("t\t", CRITICAL, seq=1), 1.0)] == [first + "t"]
    assert texts.since(0.0) == first + "t"


NO_TAKEOFF_FIRST, LOW_BATTERY = 0x1FE4222, 0x14D0DA4


def event(number: int) -> Message:
    return Event(number, 1000, 1, 0, 0, 0x33, [0] * 40)


def test_reasons_that_a_px4_sends_as_events_are_texts_for_log_and_agent(tmp_path: Path) -> None:
    sky = Sky(tmp_path)
    sky.downlink += [event(NO_TAKEOFF_FIRST), event(LOW_BATTERY), event(1)]
    sky.wait(1)
    rejected = "mission rejected: the takeoff is not its first item that is flown"
    assert believed(sky) == [(Atom("critical"), rejected), (Atom("warning"), "battery low")]


def test_an_event_is_not_told_again_where_the_vehicle_sends_texts() -> None:
    texts = Texts()
    texts.receive(text("Low battery\t"), 1.0)
    assert texts.receive_event(EVENTS[LOW_BATTERY], 1.1) == []
    assert len(texts.receive_event(EVENTS[NO_TAKEOFF_FIRST], 1.1)) == 1


@pytest.mark.parametrize("silence", [0, 20])
def test_a_clock_that_begins_again_after_49_days_is_no_reboot(tmp_path: Path, silence: float) -> None:
    sky = Sky(tmp_path).flying(10)
    wraps = sky.vehicle.age + 15

    def hears(message: Message) -> bool:
        if (boot_ms := getattr(message, "time_boot_ms", None)) is not None:
            message.time_boot_ms = (boot_ms - round(wraps * 1000)) % 2**32
        return not wraps - silence / 2 < sky.vehicle.age < wraps + silence / 2

    sky.we_hear = hears
    sky.wait(30)
    assert sky.driver.vehicle.reboots == 0
