"""Links that break and come back, and what a robot's agents are told of it."""

import asyncio
import errno
import os
import pty
from pathlib import Path

from bridged.drivers.api import Reading
from bridged.drivers.mavlink.transport import endpoint
from bridged.drivers.mavlink.transport.address import LinkAddress
from bridged.drivers.mavlink.transport.endpoint import UdpSocket
from bridged.drivers.mavlink.transport.framing import Encoder
from bridged.drivers.mavlink.transport.link import Link, open_link
from bridged.drivers.mavlink.vehicle.readings import LinkState
from schemas.manifest.loader import read_manifest
from schemas.wire.terms import Atom
from tests.bridged.radio import BEAT, Ride, Speaker, place, riding
from tests.support.buses import until
from tests.support.notes import identities
from tests.support.ports import free_port

UP, DOWN = Atom("up"), Atom("down")


class Told:
    """What was told of a link, in virtual time."""

    def __init__(self) -> None:
        self.states: list[object] = []
        self.link = LinkState(self._take)

    def _take(self, reading: Reading) -> None:
        assert reading.source == "LINK"
        self.states.append(reading.fields["state"])

    def look(self, now: float, heard_at: float = -1e9, patience: float = 5.0) -> list[object]:
        self.link.look(now - heard_at <= patience, heard_at, now, patience)
        return self.states


def test_a_vehicle_that_is_never_heard_is_down_after_the_silence_that_the_manifest_declares_not_before() -> None:
    told = Told()
    assert told.look(100.0) == []
    assert told.look(105.0) == []
    assert told.look(105.1) == [DOWN]
    assert told.look(200.0) == [DOWN], "told once"


def test_each_change_is_told_once() -> None:
    told = Told()
    for now, heard_at, states in (
        (0.0, -1e9, []),
        (1.0, 1.0, [UP]),
        (2.0, 2.0, [UP]),
        (7.5, 2.0, [UP, DOWN]),
        (9.0, 2.0, [UP, DOWN]),
        (10.0, 10.0, [UP, DOWN, UP]),
    ):
        assert told.look(now, heard_at) == states


def test_a_transport_that_is_down_is_told_at_once_and_up_needs_a_heartbeat_after_it() -> None:
    told = Told()
    told.look(1.0, 1.0)
    told.link.carry(False, 2.0)
    assert told.look(2.0, 1.0) == [UP, DOWN]
    told.link.carry(True, 3.0)
    assert told.look(3.0, 1.0) == [UP, DOWN], "the device is there again, but nobody speaks yet"
    assert told.look(4.0, 4.0) == [UP, DOWN, UP]


def test_a_transport_that_is_not_open_yet_is_no_loss_before_the_vehicle_was_missed() -> None:
    told = Told()
    told.link.carry(False, 0.0)
    assert told.look(0.0) == []
    told.link.carry(True, 1.0)
    assert told.look(2.0, 2.0) == [UP]


WATCHFUL = read_manifest(
    '[robot]\ndriver = "mavlink"\nvehicle = "copter"\nlink_loss = "1s"\n'
    '[percepts.link]\nsource = "LINK"\nargs = ["state"]\n',
    "watchful.toml",
)


def states(ride: Ride) -> list[object]:
    return [one.fields["state"] for one in ride.readings if one.source == "LINK" and one.fields is not None]


async def test_a_serial_device_that_is_unplugged_is_link_down_and_plugged_in_again_it_is_found_under_its_name(
    tmp_path: Path,
) -> None:
    name = tmp_path / "telemetry"

    def plug_in() -> int:
        far, near = pty.openpty()
        name.unlink(missing_ok=True)
        name.symlink_to(os.ttyname(near))
        plugged.append(near)
        return far

    plugged: list[int] = []
    far, vehicle = plug_in(), Encoder(1, 1)
    async with riding(f"link: 'serial:{name}:57600'", manifest=WATCHFUL) as [ride]:
        os.close(plugged.pop())
        os.write(far, vehicle.pack(BEAT))
        await until(lambda: states(ride) == [UP], "the vehicle is heard")
        os.close(far)
        name.unlink()
        await until(lambda: states(ride) == [UP, DOWN], "unplugged")
        said = {("link_down", f"serial:{name}:57600")}
        await until(lambda: said <= set(identities(ride.driver.notes())), "the note")
        await until(lambda: any("no such file or" in note.text for note in ride.driver.notes()), "the note says why")
        far = plug_in()

        def again() -> bool:
            os.write(far, vehicle.pack(BEAT))
            return states(ride) == [UP, DOWN, UP]

        await until(again, "plugged in again")
        assert ride.driver.counters()["link_reopened"] == 1
        os.close(plugged.pop())
        os.close(far)


async def test_a_tcp_vehicle_that_reboots_is_link_down_and_up() -> None:
    port, connected = free_port(), asyncio.Queue[asyncio.StreamWriter]()

    async def listen() -> asyncio.Server:
        return await asyncio.start_server(lambda _, writer: connected.put_nowait(writer), "127.0.0.1", port)

    server = await listen()
    async with riding(f"link: 'tcp:127.0.0.1:{port}'", manifest=WATCHFUL) as [ride]:
        vehicle = await connected.get()
        vehicle.write(Encoder(1, 1).pack(BEAT))
        await until(lambda: states(ride) == [UP], "the vehicle is heard")
        server.close()
        vehicle.transport.abort()
        await until(lambda: states(ride) == [UP, DOWN], "the connection is gone")
        server = await listen()
        vehicle = await connected.get()
        vehicle.write(Encoder(1, 1).pack(BEAT))
        await until(lambda: states(ride) == [UP, DOWN, UP], "connected again")
        vehicle.close()
    server.close()


async def opened(text: str) -> tuple[Link, list[bool]]:
    """A link, and what it tells of its state."""
    told: list[bool] = []
    address = LinkAddress.parse(text)
    link = await open_link(
        address, lambda message, peer: None, system=255, component=1, on_state=lambda up, _: told.append(up)
    )
    return link, told


def socket_of(link: Link) -> UdpSocket:
    """What the event loop tells of errors of the link's socket now."""
    assert isinstance(link._endpoint, endpoint.Supervised)
    found = link._endpoint._present.close.__self__  # type: ignore[attr-defined]
    assert isinstance(found, UdpSocket)
    return found


async def test_a_udp_link_whose_network_went_is_opened_again_with_a_socket_of_the_new_one() -> None:
    vehicle = Speaker()
    link, told = await opened(f"udpout:127.0.0.1:{vehicle.port}")
    link.send(BEAT)
    await until(lambda: len(vehicle.listen()) == 1, "heard")
    first = socket_of(link)
    first.error_received(OSError(errno.ENETUNREACH, "unreachable"))
    assert not link.send(BEAT), "there is no way now"
    await until(lambda: told == [True, False, True], "opened again")
    assert socket_of(link) is not first
    assert link.counters.reopened == 1
    assert link.send(BEAT)
    await until(lambda: len(vehicle.listen()) == 2, "heard again")
    await link.close()
    vehicle.close()


async def test_a_listening_link_outlives_one_way_that_is_closed_and_is_opened_again_without_its_address() -> None:
    port = free_port()
    link, told = await opened(f"udpin:127.0.0.1:{port}")
    socket_of(link).error_received(OSError(errno.EHOSTUNREACH, "one of several vehicles is out of reach"))
    socket_of(link).error_received(ConnectionRefusedError(errno.ECONNREFUSED, "nobody listens"))
    assert (told, link.counters.errors) == ([True], 2)
    socket_of(link).error_received(OSError(errno.EADDRNOTAVAIL, "its own address has gone"))
    await until(lambda: told == [True, False, True], "opened again")
    vehicle = Speaker(port)
    vehicle.say(BEAT, place())
    await until(lambda: bool(link.peers_of(1)), "heard again")
    await link.close()
    vehicle.close()


async def test_attempts_to_open_a_link_come_less_often_while_it_does_not_hold() -> None:
    link, _ = await opened(f"udpout:127.0.0.1:{free_port()}")
    loop, moments = asyncio.get_running_loop(), list[float]()
    for reopened in range(1, 4):
        socket_of(link).error_received(OSError(errno.ENETDOWN, "down"))
        begun = loop.time()
        await until(lambda: link.counters.reopened == reopened and link.up, "open again")  # noqa: B023
        moments.append(loop.time() - begun)
    assert moments[0] < moments[1] < moments[2] < endpoint.BACKOFF_S[1]
    await link.close()
