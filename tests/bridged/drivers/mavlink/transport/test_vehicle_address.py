"""A vehicle is a system id and an address: what others say in its name is told, not taken; two of one id as well."""

import asyncio

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.action_binding import leads_down, may_lead_down
from bridged.drivers.mavlink.actions.context import BoundAction
from bridged.drivers.mavlink.driver import MavlinkDriver
from bridged.drivers.mavlink.transport.endpoint import Peer
from bridged.drivers.mavlink.transport.vehicle_address import BACK_WITHIN, VehicleAddress
from bridged.drivers.mavlink.vehicle.flight_modes import MODE_TABLES
from schemas.manifest.loader import load_manifest
from tests.bridged.radio import Speaker, place, riding
from tests.support.buses import until
from tests.support.ports import free_port

MANIFEST = load_manifest("copter")
BEAT = dialect.MAVLink_heartbeat_message(2, 3, 1, 4, 4, 3)


def two_told(driver: MavlinkDriver) -> bool:
    return any(note.code == "two_vehicles" for note in driver.notes())


class Sender:
    """Peers by name, and the judgement of a vehicle whose link is lost after 5 s."""

    def __init__(self) -> None:
        self.address = VehicleAddress(1, link_loss=5.0)
        self._peers: dict[str, Peer] = {}

    def peer(self, name: str) -> Peer:
        return self._peers.setdefault(name, Peer(name, lambda data: True))

    def beats(self, name: str, now: float) -> bool:
        return self.address.counts(self.peer(name), now, heartbeat=True)

    def speaks(self, name: str, now: float) -> bool:
        return self.address.counts(self.peer(name), now, heartbeat=False)

    def codes(self, now: float) -> set[str]:
        return {note.code for note in self.address.notes(now)}


def test_two_vehicles_of_one_system_id_are_a_warning_while_both_speak(caplog: pytest.LogCaptureFixture) -> None:
    sender = Sender()
    for second in range(10):
        assert sender.beats("udp:a:1", second)
        assert not sender.beats("udp:b:2", second + 0.5), "the established one keeps counting"
    said = "two vehicles are system 1, at udp:a:1 and udp:b:2: give each its own MAV_SYSID"
    assert sender.address.two_vehicles(10.0) == said
    assert [one.message for one in caplog.records].count(said) == 1, "the log says it once"
    assert sender.codes(10.0) == {"two_vehicles", "foreign_packets"}
    for second in range(10, 30):
        sender.beats("udp:b:2", second)
    assert sender.address.two_vehicles(30.0) == ""


def test_a_vehicle_that_comes_back_from_another_port_is_one_vehicle_that_counts_after_a_link_loss() -> None:
    sender = Sender()
    for second in range(100):
        taken = sender.beats(f"udp:a:{second // 20}", second)
        assert sender.address.two_vehicles(second) == ""
        assert taken == (second < 20 or second % 20 > 4), second
        assert ("vehicle_moved" in sender.codes(second)) == (second > 20 and 4 < second % 20 < 15)


def test_an_address_that_is_used_again_much_later_is_one_vehicle() -> None:
    sender = Sender()
    for name, now in (("a", 0.0), ("b", 1.0), ("a", BACK_WITHIN + 1.0)):
        sender.beats(name, now)
    assert sender.address.two_vehicles(BACK_WITHIN + 1.0) == ""


def test_what_another_address_says_without_heartbeats_never_counts_however_long_the_vehicle_is_silent() -> None:
    sender = Sender()
    assert not sender.speaks("b", 0.0), "before the first HEARTBEAT nothing is the vehicle's word"
    assert sender.beats("a", 1.0)
    for second in range(2, 100):
        assert not sender.speaks("b", second)
    assert sender.speaks("a", 100.0)
    assert sender.address.foreign == 99


def test_what_a_vehicle_says_before_its_first_heartbeat_is_a_warning_only_if_that_does_not_come() -> None:
    vehicle, silent = Sender(), Sender()
    assert not vehicle.speaks("a", 0.0)
    assert vehicle.beats("a", 1.0)
    assert vehicle.codes(1.0) == set()
    for second in range(4):
        assert not silent.speaks("a", second)
    assert silent.codes(3.0) == {"foreign_packets"}
    assert silent.beats("a", 4.0)
    assert silent.codes(4.0) == set()


def test_after_this_process_stood_still_the_known_address_has_its_turn_first() -> None:
    sender = Sender()
    sender.beats("a", 0.0)
    assert not sender.beats("b", 60.0), "what waited is read in a row"
    assert sender.beats("a", 60.01)
    assert not sender.beats("b", 60.02)


def test_a_connection_that_ended_is_replaced_at_once() -> None:
    sender = Sender()
    sender.beats("tcp:a:1", 0.0)
    sender.peer("tcp:a:1").closed = True
    assert sender.beats("tcp:a:2", 0.1)
    assert sender.codes(0.1) == {"vehicle_moved"}


def test_ever_new_ports_fill_neither_the_log_nor_the_memory(caplog: pytest.LogCaptureFixture) -> None:
    sender = Sender()
    for number in range(1000):
        assert sender.beats("a", number / 100)
        assert not sender.beats(f"b{number}", number / 100)
    assert len(caplog.records) < 4
    assert len(sender.address._heard) <= 8


async def test_a_position_and_an_acknowledgement_from_a_second_port_do_not_move_the_vehicle_for_the_agent() -> None:
    """What an assessment did: telemetry of the vehicle's ids from elsewhere, and `goto` succeeded at once."""
    port = free_port()
    async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
        vehicle, forger, camera = Speaker(port), Speaker(port), Speaker(port, component=100)
        state = ride.driver.vehicle
        vehicle.say(FLYING, place(5.0))
        await until(lambda: state.positions == 1, "the vehicle is where it says")
        camera.say(dialect.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3))
        forger.say(place(90.0), dialect.MAVLink_command_ack_message(400, 0), FLYING, place(90.0))
        await until(lambda: ride.driver.counters()["foreign_packets"] == 4, "they are counted")
        assert (state.positions, state.position.altitude) == (1, 5.0)
        assert ride.driver.counters()["messages"] == 2, "the vehicle's own"
        said = [note for note in ride.driver.notes() if note.code == "foreign_packets"]
        assert [(note.text, note.value) for note in said] == [
            (
                f"packets of system 1 from udp:127.0.0.1:{forger.port} are refused: "
                f"its HEARTBEATs come from udp:127.0.0.1:{vehicle.port}",
                4.0,
            )
        ]
        ride.driver._send(dialect.MAVLink_command_long_message(1, 1, 400, 0, 77.0, 0, 0, 0, 0, 0, 0))
        await until(lambda: any(getattr(one, "param1", 0) == 77.0 for one in vehicle.listen()), "it is commanded")
        assert not forger.listen(), "what we say does not go to the forger"
        vehicle.say(place(6.0))
        await until(lambda: state.positions == 2, "the vehicle goes on")


async def test_two_vehicles_at_one_port_of_a_real_link_are_told_and_not_armed_companions_are_not_meant() -> None:
    port = free_port()
    async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
        driver, one, companion, other = ride.driver, Speaker(port), Speaker(port, component=191), Speaker(port)
        for _ in range(3):
            one.say(BEAT)
            companion.say(BEAT)
        await until(lambda: driver.counters()["messages"] == 3, "the vehicle is heard beside its companion")
        assert not two_told(driver)
        assert driver.refuses(MANIFEST.actions["arm_motors"]) is None
        for _ in range(3):
            one.say(BEAT)
            other.say(BEAT)
        await until(lambda: two_told(driver), "the warning")
        refusal = driver.refuses(MANIFEST.actions["arm_motors"])
        assert refusal.reason.startswith("two vehicles are system 1, at udp:127.0.0.1")


async def test_a_camera_at_an_address_of_its_own_is_spoken_to_there() -> None:
    port = free_port()
    async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
        vehicle, camera = Speaker(port), Speaker(port, component=100)
        vehicle.say(BEAT)
        camera.say(dialect.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3))
        await until(lambda: ride.driver.flight.present([100]), "the camera is heard")
        for component, mark in ((100, 1.0), (1, 2.0)):
            ride.driver._send(dialect.MAVLink_command_long_message(1, component, 2000, 0, mark, 0, 0, 0, 0, 0, 0))

        def marks(one: Speaker) -> list[float]:
            return [message.param1 for message in one.listen() if getattr(message, "command", 0) == 2000]

        await until(lambda: marks(camera) + marks(vehicle) == [1.0, 2.0], "each has its own")
        assert marks(camera) == [1.0]


async def test_what_another_address_says_in_a_cameras_name_is_no_picture_and_no_command_goes_there() -> None:
    port, camera_beat = free_port(), dialect.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3)
    async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
        vehicle, camera, forger = Speaker(port), Speaker(port, component=100), Speaker(port, component=100)
        vehicle.say(BEAT)
        camera.say(camera_beat)
        await until(lambda: ride.driver.flight.present([100]), "the camera is heard")
        forger.say(camera_beat, dialect.MAVLink_command_ack_message(2000, 0), camera_beat)
        await until(lambda: ride.driver.counters()["foreign_packets"] == 3, "they are counted")
        ride.driver._send(dialect.MAVLink_command_long_message(1, 100, 2000, 0, 7.0, 0, 0, 0, 0, 0, 0))
        await until(lambda: any(getattr(one, "param1", 0) == 7.0 for one in camera.listen()), "it is commanded")
        assert not forger.listen(), "what is for the camera does not go to the forger"
        said = [note.text for note in ride.driver.notes() if note.code == "foreign_packets"]
        assert said == [
            f"packets of component 100 of system 1 from udp:127.0.0.1:{forger.port} are refused: "
            f"it is at udp:127.0.0.1:{camera.port}"
        ]


def test_a_part_that_falls_silent_is_taken_at_its_new_address_and_at_the_vehicles_own_at_any_time() -> None:
    address = VehicleAddress(1)
    own, first, second = (Peer(label, lambda data: True) for label in ("udp:own", "udp:first", "udp:second"))
    address.counts(own, 0.0, heartbeat=True)
    heard = [(first, 0.0), (second, 2.9), (first, 2.9), (second, 5.9), (first, 6.0), (own, 6.0), (second, 6.5)]
    taken = [address.counts_of_part(100, peer, at) for peer, at in heard]
    assert taken == [True, False, True, True, False, True, False]


FLYING = dialect.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3)


def test_two_vehicles_of_one_id_in_flight_are_left_their_ways_down_which_go_to_both() -> None:
    async def body() -> None:
        port = free_port()
        async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
            driver, one, other = ride.driver, Speaker(port), Speaker(port)

            def both_told() -> bool:
                one.say(FLYING)
                other.say(FLYING)
                return two_told(driver)

            await until(both_told, "the warning")
            where = sorted(f"udp:127.0.0.1:{vehicle.port}" for vehicle in (one, other))
            said = f"two vehicles are system 1, at {' and '.join(where)}"
            for name in ("takeoff", "goto", "setpoint"):
                refusal = driver.refuses(MANIFEST.actions[name])
                assert refusal.reason.startswith(said)
            for name in ("land", "return_to_launch", "set_mode", "arm_motors"):
                assert driver.refuses(MANIFEST.actions[name]) is None
            for name, arguments in (("set_mode", {"mode": "GUIDED"}), ("arm_motors", {"arm": True})):
                outcome = driver.perform(name, MANIFEST.actions[name], arguments).outcome
                assert (outcome.state, outcome.reason.startswith(said)) == ("refused", True)
            rtl = driver.perform("set_mode", MANIFEST.actions["set_mode"], {"mode": "RTL"})
            assert not rtl.over

            def told_to_return(vehicle: Speaker) -> bool:
                commands = [heard for heard in vehicle.listen() if heard.get_type() == "COMMAND_LONG"]
                return any((heard.command, heard.param2) == (176, 6.0) for heard in commands)

            await until(lambda: told_to_return(one) and told_to_return(other), "both are told to return")

    asyncio.run(body())


@pytest.mark.parametrize("manifest", ["plane", "rover"])
def test_a_return_that_does_not_land_is_a_way_down_too(manifest: str) -> None:
    entry = load_manifest(manifest).actions["return_to_launch"]
    assert entry.confirm == "at_home"
    assert may_lead_down(entry)
    assert leads_down(entry, BoundAction(), MODE_TABLES[manifest])
