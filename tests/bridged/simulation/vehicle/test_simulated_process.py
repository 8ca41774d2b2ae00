"""The simulated vehicles as processes on real links: a pilot's link of its own, each kind, a bad link."""

import asyncio
import signal
from contextlib import closing

import pytest

from tests.bridged.drivers.mavlink.test_ground_stations import copter
from tests.bridged.radio import Speaker
from tests.support.buses import until


async def test_a_pilot_on_a_link_of_his_own_changes_the_mode_and_the_bridge_sees_it() -> None:
    bridge, pilot = Speaker(system=255, component=190), Speaker(system=255, component=190)
    links = [f"udpout:127.0.0.1:{one.port}" for one in (bridge, pilot)]
    with closing(bridge), closing(pilot), copter(links[0], "--link", links[1], "--speed", "10"):
        await bridge.hears("HEARTBEAT", custom_mode=0)
        await pilot.hears("HEARTBEAT", custom_mode=0)
        await pilot.hears("HOME_POSITION")  # the start of the vehicle is over
        pilot.command(176, 1, 4)
        await pilot.hears("COMMAND_ACK", command=176, result=0)
        await bridge.hears("HEARTBEAT", custom_mode=4)
        assert not bridge.find("COMMAND_ACK")


@pytest.mark.parametrize(("vehicle", "autopilot", "type_"), [("rover", "ardupilot", 10), ("plane", "px4", 1)])
async def test_any_kind_may_be_a_process_and_is_armed(vehicle: str, autopilot: str, type_: int) -> None:
    bridge = Speaker(system=255, component=190)
    link = f"udpout:127.0.0.1:{bridge.port}"
    with closing(bridge), copter(link, "--autopilot", autopilot, "--speed", "10", vehicle=vehicle):
        beat = await bridge.hears("HEARTBEAT", type=type_)
        assert beat.autopilot == {"ardupilot": 3, "px4": 12}[autopilot]
        await bridge.hears("HOME_POSITION")

        def armed() -> bool:
            bridge.command(400, 1)
            return any(one.base_mode & 128 for one in bridge.find("HEARTBEAT"))

        await until(armed, "its motors turn")


def test_a_copter_on_a_bad_link_is_still_heard_and_tells_what_was_lost() -> None:
    station = Speaker(system=255, component=190)
    faults = ("--fault", "loss=0.3,duplicate=0.3", "--fault", "garbage=0.3")
    with closing(station), copter(f"udpout:127.0.0.1:{station.port}", *faults, "--speed", "20") as process:
        asyncio.run(until(lambda: len(station.listen()) >= 40, "the copter is heard 40 times"))
        process.send_signal(signal.SIGTERM)
        _, printed = process.communicate(timeout=90)
    for what in (" lost, ", " doubled, ", "bursts of garbage"):
        assert what in printed
    assert station.counters.skipped_bytes > 0
