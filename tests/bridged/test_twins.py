"""Two vehicles with equal system ids on one link are told; a vehicle that reboots is not taken for two."""

from __future__ import annotations

import asyncio
import logging
import socket
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.driver import MavlinkDriver
from bridged.drivers.mavlink.flight import Call
from bridged.drivers.mavlink.modes import MODE_TABLES
from bridged.drivers.mavlink.twins import BACK_WITHIN, Twins, leads_down, may_lead_down
from bridged.drivers.mavlink.wire import Encoder
from bridged.drivers.robot import Setup
from commd.clock import Clock
from schemas.manifest import load_manifest
from schemas.mission import read_mission
from tests.bridged.radio import Speaker, riding
from tests.bridged.sky import MISSION
from tests.support.buses import until
from tests.support.ports import free_port

MANIFEST = load_manifest("arducopter")
BEAT = dialect.MAVLink_heartbeat_message(2, 3, 1, 4, 4, 3)


def test_two_vehicles_of_one_system_id_are_a_warning_while_both_speak(caplog: pytest.LogCaptureFixture) -> None:
    twins = Twins(1)
    for second in range(10):
        twins.heard("udp:a:1", second)
        twins.heard("udp:b:2", second + 0.5)
    said = "two vehicles are system 1, at udp:a:1 and udp:b:2: give each its own MAV_SYSID"
    [note] = twins.notes(10.0)
    assert note.startswith(said)
    assert [record.message for record in caplog.records] == [note], "the log says it once"
    for second in range(10, 20):
        twins.heard("udp:b:2", second)
    assert twins.notes(20.0) == []


def test_three_of_them_are_a_warning_too() -> None:
    twins = Twins(1)
    for second in range(3):
        for address in ("a", "b", "c"):
            twins.heard(address, second)
    assert twins.notes(2.0)


def test_a_vehicle_that_comes_back_from_another_port_is_one_vehicle() -> None:
    twins = Twins(1)
    for second in range(100):
        twins.heard(f"udp:a:{second // 10}", second)
        assert twins.notes(second) == []


def test_an_address_that_is_used_again_much_later_is_one_vehicle() -> None:
    twins = Twins(1)
    for address, wall in (("a", 0.0), ("b", 1.0), ("a", BACK_WITHIN + 1.0)):
        twins.heard(address, wall)
    assert twins.notes(BACK_WITHIN + 1.0) == []


def test_two_vehicles_at_one_port_of_a_real_link_are_told_and_not_armed_and_their_companions_are_not_meant(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.WARNING)
    port = free_port()
    robot = read_mission(MISSION.replace("127.0.0.1:0", f"127.0.0.1:{port}"), Path("test.yaml")).robots["uav1"]

    async def body() -> None:
        driver = MavlinkDriver(Setup("uav1", MANIFEST, robot, Path(), Clock(), lambda reading: None, lambda: None))
        driving = asyncio.create_task(driver.run())
        await until(lambda: "bad_checksums" in driver.counters(), "the link is open")
        with socket.socket(type=socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as other:

            def speak(component: int) -> None:
                for vehicle, at in ((one, 1), (other, component)):
                    vehicle.sendto(Encoder(1, at).pack(BEAT), ("127.0.0.1", port))

            for _ in range(3):
                speak(191)
                await asyncio.sleep(0.05)
            await until(lambda: driver.counters()["messages"] == 3, "the vehicle is heard beside its companion")
            assert not [note for note in driver.notes() if "two vehicles" in note]
            assert driver.refuses(MANIFEST.actions["arm_motors"]) == ""
            for _ in range(3):
                speak(1)
                await asyncio.sleep(0.05)
            await until(lambda: any("two vehicles" in note for note in driver.notes()), "the warning")
            assert driver.refuses(MANIFEST.actions["arm_motors"]).startswith(
                "two vehicles are system 1, at udp:127.0.0.1"
            )
        driving.cancel()
        await asyncio.gather(driving, return_exceptions=True)

    asyncio.run(body())
    assert "two vehicles are system 1" in caplog.text


FLYING = dialect.MAVLink_heartbeat_message(2, 3, 129, 4, 4, 3)


def test_two_vehicles_of_one_id_in_flight_are_left_their_ways_down_which_go_to_both() -> None:
    async def body() -> None:
        port = free_port()
        async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
            driver, one, other = ride.driver, Speaker(port), Speaker(port)

            def both_told() -> bool:
                one.say(FLYING)
                other.say(FLYING)
                return any("two vehicles" in note for note in driver.notes())

            await until(both_told, "the warning")
            where = sorted(f"udp:127.0.0.1:{vehicle.port}" for vehicle in (one, other))
            said = f"two vehicles are system 1, at {' and '.join(where)}"
            for name in ("takeoff", "goto", "setpoint"):
                assert driver.refuses(MANIFEST.actions[name]).startswith(said)
            for name in ("land", "return_to_launch", "set_mode", "arm_motors"):
                assert driver.refuses(MANIFEST.actions[name]) == ""
            for name, arguments in (("set_mode", {"mode": "GUIDED"}), ("arm_motors", {"arm": True})):
                outcome = driver.perform(name, MANIFEST.actions[name], arguments).outcome
                assert outcome is not None
                assert (outcome.state, outcome.reason.startswith(said)) == ("refused", True)
            rtl = driver.perform("set_mode", MANIFEST.actions["set_mode"], {"mode": "RTL"})
            assert not rtl.over

            def told_to_return(vehicle: Speaker) -> bool:
                commands = [heard for heard in vehicle.listen() if heard.get_type() == "COMMAND_LONG"]
                return any((heard.command, heard.param2) == (176, 6.0) for heard in commands)

            await until(lambda: told_to_return(one) and told_to_return(other), "both are told to return")
            for vehicle in (one, other):
                vehicle.close()

    asyncio.run(body())


@pytest.mark.parametrize("manifest", ["arduplane", "ardurover"])
def test_a_return_that_does_not_land_is_a_way_down_too(manifest: str) -> None:
    entry = load_manifest(manifest).actions["return_to_launch"]
    assert entry.confirm == "at_home"
    assert may_lead_down(entry)
    assert leads_down(entry, Call(), MODE_TABLES[manifest])
