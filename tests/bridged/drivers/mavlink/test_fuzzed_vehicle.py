"""Whatever a vehicle sends, the bridge neither fails nor grows: real packets, absurd contents."""

import struct
import tempfile
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Framer, WireCounters
from tests.bridged.sky import GOAL, Sky
from tests.support.amount import some_of

HEARD = (
    "HEARTBEAT",
    "SYS_STATUS",
    "GPS_RAW_INT",
    "GLOBAL_POSITION_INT",
    "POSITION_TARGET_GLOBAL_INT",
    "HOME_POSITION",
    "EKF_STATUS_REPORT",
    "EXTENDED_SYS_STATE",
    "COMMAND_ACK",
    "STATUSTEXT",
    "PARAM_VALUE",
    "BATTERY_STATUS",
)
KINDS = [kind for kind in dialect.mavlink_map.values() if kind.msgname in HEARD]
ACTIONS = (
    ("set_mode", "GUIDED"),
    ("arm_motors", True),
    ("takeoff", 5),
    ("goto", *GOAL),
    ("land",),
    ("return_to_launch",),
)


@st.composite
def packets(draw: st.DrawFn) -> bytes:
    """A packet of the vehicle with a right checksum and any payload."""
    kind = draw(st.sampled_from(KINDS))
    payload = draw(st.binary(min_size=1, max_size=struct.calcsize(kind.unpacker.format)))
    number = kind.id
    header = struct.pack("<BBBBBBB", len(payload), 0, 0, draw(st.integers(0, 255)), 1, 1, number & 255)
    covered = header + bytes((number >> 8 & 255, number >> 16 & 255)) + payload
    checksum = dialect.x25crc(covered + bytes((kind.crc_extra,))).crc
    return b"\xfd" + covered + struct.pack("<H", checksum)


@settings(max_examples=some_of(60, 2), deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(packets(), st.sampled_from([0.0, 0.02, 0.5, 3.0])), max_size=40), st.sampled_from(ACTIONS))
def test_absurd_messages_end_each_action_once(said: list[tuple[bytes, float]], action: tuple[Any, ...]) -> None:
    with tempfile.TemporaryDirectory() as state:
        sky = Sky(Path(state))
        framer = Framer(WireCounters())
        sky.wait(1)
        heard = sky.begin(action[0], *action[1:], deadline=60.0)
        for packet, pause in said:
            for message in framer.feed(packet):
                sky.driver.receive(message)
            sky.wait(pause)
        sky.we_hear = lambda message: False
        sky.end(heard, 80)
        assert [one.final for one in heard].count(True) == 1
        assert heard[-1].reason or heard[-1].state == "succeeded"
        assert len(sky.bridge.percepts.sets["uav"]) < 300
        sky.bridge.action_log.close()
