"""The simulated vehicles as processes on real links: a pilot's link of its own, signatures, faults."""

from __future__ import annotations

import asyncio
import signal

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.link import Link, LinkAddress, open_link
from bridged.drivers.mavlink.transport.signing import Signing
from tests.bridged.drivers.mavlink.test_ground_stations import copter
from tests.support.buses import async_test, until
from tests.support.ports import free_port

PATIENCE = 90.0


class Station:
    """One who speaks with the copter over UDP: a bridge, or a pilot's ground station."""

    def __init__(self) -> None:
        self.heard: list[dialect.MAVLink_message] = []
        self.link: Link

    async def open(self, port: int, signing: Signing | None = None) -> Station:
        self.link = await open_link(
            LinkAddress.parse(f"udpin:127.0.0.1:{port}"),
            lambda message, _: self.heard.append(message),
            system=255,
            component=190,
            signing=signing,
        )
        return self

    async def until(self, kind: str, **fields: int) -> dialect.MAVLink_message:
        """The first message of this kind with these fields that was heard."""
        async with asyncio.timeout(PATIENCE):
            while True:
                for message in self.heard:
                    if message.get_type() == kind and all(getattr(message, k) == v for k, v in fields.items()):
                        return message
                await asyncio.sleep(0.01)

    def command(self, number: int, *params: float) -> None:
        padded = (*params, *([0.0] * (7 - len(params))))
        self.link.send(dialect.MAVLink_command_long_message(1, 1, number, 0, *padded))


@async_test
async def test_a_pilot_on_a_link_of_his_own_changes_the_mode_and_the_bridge_sees_it() -> None:
    ports = [free_port(), free_port()]
    bridge, pilot = [await Station().open(port) for port in ports]
    links = [f"udpout:127.0.0.1:{port}" for port in ports]
    with copter(links[0], "--link", links[1], "--speed", "10"):
        await bridge.until("HEARTBEAT", custom_mode=0)
        await pilot.until("HEARTBEAT", custom_mode=0)
        await pilot.until("HOME_POSITION")  # the start of the vehicle is over
        pilot.command(176, 1, 4)
        await pilot.until("COMMAND_ACK", command=176, result=0)
        await bridge.until("HEARTBEAT", custom_mode=4)
        assert not [one for one in bridge.heard if one.get_type() == "COMMAND_ACK"]
        await bridge.link.close()
        await pilot.link.close()


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "type_"),
    [
        ("plane", "ardupilot", 1),
        ("rover", "ardupilot", 10),
        ("copter", "px4", 2),
        ("plane", "px4", 1),
        ("rover", "px4", 10),
    ],
)
@async_test
async def test_each_kind_is_a_process_and_is_armed(vehicle: str, autopilot: str, type_: int) -> None:
    port = free_port()
    bridge = await Station().open(port)
    with copter(f"udpout:127.0.0.1:{port}", "--autopilot", autopilot, "--speed", "10", vehicle=vehicle):
        beat = await bridge.until("HEARTBEAT", type=type_)
        assert beat.autopilot == {"ardupilot": 3, "px4": 12}[autopilot]
        await bridge.until("HOME_POSITION")
        async with asyncio.timeout(PATIENCE):
            while not any(one.get_type() == "HEARTBEAT" and one.base_mode & 128 for one in bridge.heard):
                bridge.command(400, 1)
                await asyncio.sleep(0.2)
        await bridge.link.close()


def test_a_copter_on_a_bad_link_is_still_heard_and_tells_what_was_lost() -> None:
    async def story() -> tuple[str, Station]:
        port = free_port()
        station = await Station().open(port)
        with copter(
            f"udpout:127.0.0.1:{port}", "--fault", "loss=0.3,duplicate=0.3", "--fault", "garbage=0.3", "--speed", "20"
        ) as process:
            await until(lambda: len(station.heard) >= 40, "the copter is heard 40 times")
            await station.link.close()
            process.send_signal(signal.SIGTERM)
            _, printed = process.communicate(timeout=PATIENCE)
        return str(printed), station

    printed, station = asyncio.run(story())
    assert " lost, " in printed
    assert " doubled, " in printed
    assert "bursts of garbage" in printed
    assert station.link.counters.skipped_bytes > 0


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--fault", "rain"], "bridged simulate: error: expected one of loss=SHARE, duplicate=SHARE, "),
        (["--param", "RTL_HEIGHT=3"], "bridged simulate: error: the simulated copter has no parameter 'RTL_HEIGHT'"),
        (["--param", "RTL_ALT"], "argument --param: expected NAME=VALUE such as FS_GCS_ENABLE=1, got 'RTL_ALT'"),
        (["--signing-passphrase-file", "/nowhere"], "bridged simulate: error: /nowhere: no such file or directory"),
        (["--battery-minutes", "0"], "argument --battery-minutes: expected minutes between 0.1 and 10000, got '0'"),
    ],
)
def test_what_cannot_be_simulated_is_one_clear_line_and_exit_code_2(arguments: list[str], complaint: str) -> None:
    with copter("udpin:127.0.0.1:0", *arguments) as process:
        _, printed = process.communicate(timeout=PATIENCE)
        assert process.returncode == 2
    assert complaint in printed
