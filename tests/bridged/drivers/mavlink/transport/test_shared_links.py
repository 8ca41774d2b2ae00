"""Several robots at one link: each hears its own vehicle and is answered by it, whatever becomes of the others."""

import asyncio
import socket
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.registration import check_robot
from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.drivers.mavlink.transport.link import LinkError
from bridged.drivers.mavlink.vehicle.gcs_failsafe import our_ids
from bridged.drivers.mavlink.vehicle.streams import FOR_PERCEPTS_ONLY
from schemas.manifest.loader import read_manifest
from schemas.mission.model import Failsafe, Ids
from tests.bridged.radio import BEAT, COPTER, STATION_BEAT, Speaker, place, riding, robot_of, spoken_as
from tests.support.buses import until
from tests.support.notes import identities
from tests.support.ports import free_port


def link(port: int, system: int, more: str = "") -> str:
    return f"link: 'udpin:127.0.0.1:{port}', sysid: {system}{more}"


async def test_each_robot_of_a_link_hears_its_own_vehicle_and_answers_it_alone_under_its_own_ids() -> None:
    port = free_port()
    bridge_is_station, own_component = ", failsafe: {gcs: bridge}", ", ids: {component: 77}"
    fields = (link(port, 1), link(port, 2, bridge_is_station), link(port, 3, own_component))
    async with riding(*fields) as rides:
        vehicles = [Speaker(port, system) for system in (1, 2, 3)]
        for vehicle, altitude in zip(vehicles, (10, 20, 30), strict=True):
            vehicle.say(BEAT, place(altitude))
        await until(lambda: all(ride.count("GLOBAL_POSITION_INT") for ride in rides), "every vehicle is heard")
        for ride, altitude in zip(rides, (10, 20, 30), strict=True):
            [fields_of] = [one.fields for one in ride.readings if one.source == "GLOBAL_POSITION_INT"]
            assert fields_of["relative_alt"] == altitude * 1000
        await until(lambda: all(vehicle.kinds() >= {"COMMAND_LONG"} for vehicle in vehicles), "all are answered")
        for vehicle, ids in zip(vehicles, ((1, 191), (255, 190), (3, 77)), strict=True):
            assert {spoken_as(one) for one in vehicle.listen()} == {ids}
            numbers = [one.get_seq() for one in vehicle.heard]
            assert all(later == (earlier + 1) % 256 for earlier, later in pairwise(numbers))


async def test_robots_at_one_line_have_a_row_of_sequence_numbers_for_each_pair_of_ids() -> None:
    air = Speaker(system=1)
    fields = [f"link: 'udpout:127.0.0.1:{air.port}', sysid: {system}" for system in (1, 2)]
    async with riding(*fields):
        await until(lambda: {(1, 191), (2, 191)} <= {spoken_as(one) for one in air.listen()}, "both speak")
        second = Encoder(2, 1)
        air.say(BEAT)
        air.send(second.pack(BEAT))
        await until(lambda: air.kinds(1, 191) & air.kinds(2, 191) >= {"COMMAND_LONG"}, "both are asked for streams")
    for ids in ((1, 191), (2, 191)):
        numbers = [one.get_seq() for one in air.heard if spoken_as(one) == ids]
        assert numbers == list(range(len(numbers)))


async def test_a_vehicle_that_connects_again_is_commanded_before_its_next_heartbeat() -> None:
    port, encoder = free_port(), Encoder(1, 1)
    async with riding(f"link: 'tcpin:127.0.0.1:{port}', sysid: 1") as [ride]:
        reader, before = await asyncio.open_connection("127.0.0.1", port)
        before.write(encoder.pack(BEAT))
        await reader.read(1)
        before.close()
        home = ride.driver.link_client.address.peer
        await until(lambda: home.closed, "the connection has ended")
        reader, again = await asyncio.open_connection("127.0.0.1", port)
        again.write(encoder.pack(place()))
        await until(lambda: ride.driver.link_client.address.foreign == 1, "its position is read")
        ride.driver._send(dialect.MAVLink_command_long_message(1, 1, 400, 0, 77.0, 0, 0, 0, 0, 0, 0))
        framer, heard = Framer(WireCounters()), set[float]()
        while 77.0 not in heard:  # HEARTBEATs of ours may come before it
            heard |= {getattr(one, "param1", 0) for one in framer.feed(await asyncio.wait_for(reader.read(4096), 10))}
        again.close()


async def test_a_vehicle_that_no_robot_claims_is_named_with_those_that_they_are() -> None:
    port = free_port()
    async with riding(*(link(port, system) for system in (1, 2, 3))) as rides:
        stranger, station = Speaker(port, 7), Speaker(port, 255, 230)
        stranger.say(BEAT, place())
        station.say(STATION_BEAT)
        said = ("other_system", "7")
        await until(lambda: all(said in identities(ride.driver.notes()) for ride in rides), "every robot names it")
        assert rides[0].driver.counters()["unclaimed_vehicles"] == 1
        assert ("other_system", "255") not in identities(rides[0].driver.notes()), "a ground station is no vehicle"
        assert not any(ride.readings for ride in rides)


async def test_a_robot_that_leaves_keeps_the_link_open_for_the_others_and_the_last_one_frees_the_port() -> None:
    port = free_port()
    async with riding(link(port, 1), link(port, 2)) as (first, second):
        vehicle = Speaker(port, 2)
        await first.leave()
        vehicle.say(BEAT, place())
        await until(lambda: bool(second.count("GLOBAL_POSITION_INT")), "the other one hears its vehicle")
        await second.leave()
        with socket.socket(type=socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", port))


async def test_what_fails_in_one_robot_is_reported_and_the_others_go_on() -> None:
    port, complaints = free_port(), []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context["message"]))
    async with riding(link(port, 1), link(port, 2)) as (clumsy, other):

        def fail() -> None:
            raise RuntimeError("clumsy")

        clumsy.steps = fail
        vehicles = [Speaker(port, system) for system in (1, 2)]
        for vehicle in vehicles:
            vehicle.say(BEAT, place())
        await until(lambda: bool(other.count("GLOBAL_POSITION_INT")), "the other one hears its vehicle")
        await until(lambda: bool(complaints), "the error is reported")
        assert not clumsy.running.done()


async def test_two_robots_of_one_system_at_one_link_are_one_too_many() -> None:
    port = free_port()
    async with riding(link(port, 1), link(port, 1)) as (first, second):
        with pytest.raises(LinkError, match=f"link udpin:127.0.0.1:{port}: system 1 is robot uav1 already"):
            await second.running
        assert not first.running.done()


async def test_a_link_that_cannot_be_opened_is_an_error_for_each_of_its_robots() -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        async with riding(link(port, 1), link(port, 2)) as rides:
            for ride in rides:
                with pytest.raises(LinkError, match="cannot be opened: address already in use"):
                    await ride.running


TURNED = read_manifest(
    '[robot]\ndriver = "mavlink"\nvehicle = "copter"\n[percepts.roll]\nsource = "ATTITUDE"\nargs = ["roll"]\n',
    "turned.toml",
)


@pytest.mark.parametrize(("manifest", "reads"), [(COPTER, False), (TURNED, True)])
async def test_messages_that_no_percept_is_made_of_are_counted_and_not_decoded(manifest: Any, reads: bool) -> None:
    port, attitude = free_port(), dialect.MAVLink_attitude_message(0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)
    async with riding(link(port, 1), manifest=manifest) as [ride]:
        vehicle = Speaker(port, 1)
        vehicle.say(BEAT, attitude, attitude, place())
        await until(lambda: ride.driver.counters()["messages"] == (4 if reads else 2), "the messages are heard")
        assert ride.driver.counters()["unwanted_packets"] == (0 if reads else 2)
        assert ride.count("ATTITUDE") == (2 if reads else 0)


def test_what_is_left_unread_is_telemetry_that_the_dialect_has() -> None:
    for name in FOR_PERCEPTS_ONLY:
        assert getattr(dialect, f"MAVLINK_MSG_ID_{name}") in dialect.mavlink_map


def test_a_message_of_the_dialect_has_its_fields_as_attributes_of_its_own_and_texts_as_strings() -> None:
    for kind in [one for one in dialect.mavlink_map.values() if one.__module__ == dialect.__name__]:
        size = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        fields = zip(kind.fieldnames, kind.fieldtypes, strict=True)
        values = {name: b"text" if of == "char" else [0] * size[name] if size[name] else 0 for name, of in fields}
        message = vars(kind(*values.values()))
        assert {name: message[name] for name in values} == {
            name: "text" if value == b"text" else value for name, value in values.items()
        }


@pytest.mark.parametrize(
    ("gcs", "ids", "spoken"),
    [
        ("none", Ids(), (4, 191)),
        ("human", Ids(), (4, 191)),
        ("bridge", Ids(), (255, 190)),
        ("bridge", Ids(component=191), (255, 191)),
        ("none", Ids(system=250, component=1), (250, 1)),
    ],
)
def test_we_speak_as_the_failsafe_wants_it_or_as_the_mission_says(gcs: Any, ids: Ids, spoken: tuple[int, int]) -> None:
    identity = our_ids(Failsafe(gcs=gcs), 4, ids)
    assert (identity.system, identity.component, identity.vehicle) == (*spoken, 4)


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ("ids: {system: 250}, failsafe: {gcs: bridge}", "`failsafe: {gcs: bridge}` has no effect with system 250"),
        ("ids: {system: 255}, failsafe: {gcs: human}", "`failsafe: {gcs: human}` has no effect with system 255"),
        ("ids: {component: 1}", "1/1 are the ids of the vehicle's own autopilot: choose another component"),
        ("ids: {component: 191}, failsafe: {gcs: bridge}", ""),
        ("ids: {system: 255}", ""),
    ],
)
def test_ids_that_undo_the_failsafe_are_a_finding(fields: str, problem: str) -> None:
    found = list(check_robot(robot_of(f"link: 'udpin:127.0.0.1:1', {fields}")))
    assert [field for field, _ in found] == (["ids"] if problem else [])
    assert problem in "".join(text for _, text in found)


@pytest.mark.parametrize(
    ("forward", "problem"),
    [
        ("'udp:1'", "forward: link 'udp:1': expected udpin:HOST:PORT, udpout:"),
        ("['udpout:127.0.0.1:14551', 'udpout:127.0.0.1:14551']", "`udpout:127.0.0.1:14551` is listed twice"),
        ("'udpout:127.0.0.1:14550'", "is the vehicle's own link: packets would go round for ever"),
        ("['udpout:127.0.0.1:14551', 'tcpin:0.0.0.0:5760']", ""),
    ],
)
def test_a_wrong_forward_is_a_finding(forward: str, problem: str) -> None:
    found = list(check_robot(robot_of(f"link: 'udpin:127.0.0.1:14550', forward: {forward}")))
    assert [field for field, _ in found] == (["forward"] if problem else [])
    assert problem in "".join(text for _, text in found)


def test_a_passphrase_that_cannot_be_used_is_a_finding(tmp_path: Path) -> None:
    file = tmp_path / "phrase"
    robot = robot_of(f"link: 'udpin:127.0.0.1:14550', signing: {{passphrase_file: '{file}'}}")

    def problem() -> list[tuple[str, str]]:
        return [(field, text.replace(str(file), "FILE")) for field, text in check_robot(robot)]

    assert problem() == [("signing", "signing.passphrase_file: FILE: no such file or directory")]
    file.write_text("")
    file.chmod(0o600)
    assert problem() == [
        ("signing", "signing.passphrase_file: FILE: expected the passphrase in the first line, it is empty")
    ]
    file.write_text("argo")
    assert problem() == []
    file.chmod(0o644)
    [(_, text)] = problem()
    assert text == "signing.passphrase_file: FILE: others than its owner may use this file: do `chmod 600 FILE`"
