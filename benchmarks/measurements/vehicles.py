"""Vehicles that only talk: the traffic of copters in flight, at a steady rate, each position with its own altitude.

`python -m benchmarks.measurements.vehicles EVERY SYSTEM:PORT ...` is their process. It talks until SIGTERM, then prints
the times (`Report`) of each EVERYth metre; the first one differs from vehicle to vehicle (their SYSTEM).

They fly a circle: place, velocity and heading change from one position to the next as in a recorded flight
(`tests/data`), so that a bridge has as much to publish. They also climb a metre with each position, which copters do
not: the altitude identifies the position. So percepts of the height come at the full rate of the manifest, where a
copter on its way has fewer.
"""

from __future__ import annotations

import math
import select
import signal
import socket
import sys
import time
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as dialect

HOME: Final = (-276040330, -485183630, 21_000)
"""degE7, degE7, mm above mean sea level."""
POSITIONS: Final = 10
"""Hz of GLOBAL_POSITION_INT, which carries the altitude by which a position is identified."""
RADIUS, SPEED = 60.0, 5.0
"""Metres and metres a second of the circle: a round takes 75 s, in half a second heading and velocity change by more
than the deadbands of the manifest."""
_DEGREE: Final = 111_319.5
"""Metres of a degree of latitude."""
_ARMED_GUIDED: Final = dialect.MAV_MODE_FLAG_SAFETY_ARMED | dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_GUIDED: Final = 4
_IN_AIR: Final = dialect.MAV_LANDED_STATE_IN_AIR
_HEALTHY: Final = dialect.MAV_SYS_STATUS_PREARM_CHECK
_POSITION_KNOWN: Final = 831
"""EKF_STATUS_REPORT.flags of a copter that is ready, as recorded."""
PARAMETER: Final = 1500.0
"""The value of every parameter."""


@dataclass
class Talker:
    """One vehicle's socket, its protocol, and the times of what it sent."""

    system: int
    remote: tuple[str, int]
    sent: dict[int, float] = field(default_factory=dict)
    """`time.monotonic` at which each altitude (whole metres) was handed to the socket."""
    beats: list[float] = field(default_factory=list)
    """When HEARTBEATs of the bridge came."""

    def __post_init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._protocol = dialect.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self._altitude = 0

    def close(self) -> None:
        """Free the socket."""
        self._socket.close()

    def fileno(self) -> int:
        """For `select`."""
        return self._socket.fileno()

    def send(self, message: dialect.MAVLink_message) -> float:
        """Send one message. Returns the moment just before."""
        packet = message.pack(self._protocol)
        self._protocol.seq = (self._protocol.seq + 1) % 256
        now = time.monotonic()
        self._socket.sendto(packet, self.remote)
        return now

    def send_kind(self, kind: str) -> None:
        """Send a message of a kind, with the values of a copter that flies its circle."""
        if kind == "GLOBAL_POSITION_INT":
            self._altitude += 1
            height = self._altitude * 1000
            position = (0, *_place(self._altitude / POSITIONS), HOME[2] + height, height, *_course(self._altitude))
            self.sent[self._altitude] = self.send(dialect.MAVLink_global_position_int_message(*position))
        else:
            self.send(self._made(kind))

    def answer(self) -> None:
        """Read what came in, and answer."""
        while True:
            try:
                data = self._socket.recv(4096)
            except BlockingIOError:
                return
            for message in self._protocol.parse_buffer(bytearray(data)) or ():
                self._take(message)

    def _take(self, message: dialect.MAVLink_message) -> None:
        """Acknowledge a command or send a parameter; all are accepted."""
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.beats.append(time.monotonic())
        elif kind == "PARAM_REQUEST_READ" and message.target_system == self.system:
            self.send(dialect.MAVLink_param_value_message(message.param_id.encode(), PARAMETER, 9, 1, 0))
        elif kind == "COMMAND_LONG" and message.target_system == self.system:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            self.send(dialect.MAVLink_command_ack_message(message.command, 0, 0, 0, *sender))
            if message.param1 == dialect.MAVLINK_MSG_ID_HOME_POSITION:
                self.send(self._made("HOME_POSITION"))

    def _made(self, kind: str) -> dialect.MAVLink_message:
        make: dict[str, Any] = {
            "HEARTBEAT": lambda: dialect.MAVLink_heartbeat_message(2, 3, _ARMED_GUIDED, _GUIDED, 4, 3),
            "ATTITUDE": lambda: dialect.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            "SYS_STATUS": lambda: dialect.MAVLink_sys_status_message(
                _HEALTHY, _HEALTHY, _HEALTHY, 0, 12600, 2800, 90, 0, 0, 0, 0, 0, 0
            ),
            "GPS_RAW_INT": lambda: dialect.MAVLink_gps_raw_int_message(0, 6, *HOME, 100, 100, 0, 0, 10),
            "EKF_STATUS_REPORT": lambda: dialect.MAVLink_ekf_status_report_message(
                _POSITION_KNOWN, 0.0, 0.0, 0.0, 0.0, 0.0
            ),
            "EXTENDED_SYS_STATE": lambda: dialect.MAVLink_extended_sys_state_message(
                0, dialect.MAV_LANDED_STATE_IN_AIR
            ),
            "POSITION_TARGET_GLOBAL_INT": lambda: dialect.MAVLink_position_target_global_int_message(
                0, 0, 3576, HOME[0], HOME[1], 40.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            ),
            "BATTERY_STATUS": lambda: dialect.MAVLink_battery_status_message(
                0, 0, 0, 32767, [12600] + [65535] * 9, 2800, 100, -1, 90
            ),
            "HOME_POSITION": lambda: dialect.MAVLink_home_position_message(
                *HOME, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0
            ),
        }
        return make[kind]()


def _place(seconds: float) -> tuple[int, int]:
    """Return latitude and longitude (degE7) after so many seconds on the circle, whose middle is home."""
    angle = SPEED / RADIUS * seconds
    north, east = RADIUS * math.cos(angle), RADIUS * math.sin(angle)
    wide = math.cos(math.radians(HOME[0] / 1e7))
    return HOME[0] + round(1e7 * north / _DEGREE), HOME[1] + round(1e7 * east / _DEGREE / wide)


def _course(positions: int) -> tuple[int, int, int, int]:
    """Return the velocity north, east and down (cm/s) and the heading (cdeg) at that position."""
    angle = SPEED / RADIUS * positions / POSITIONS
    north, east = -SPEED * math.sin(angle), SPEED * math.cos(angle)
    heading = math.degrees(math.atan2(east, north)) % 360
    return round(100 * north), round(100 * east), 0, round(100 * heading) % 36_000


RATES: Final = {
    "HEARTBEAT": 1,
    "GLOBAL_POSITION_INT": POSITIONS,
    "ATTITUDE": 4,
    "GPS_RAW_INT": 2,
    "EKF_STATUS_REPORT": 2,
    "EXTENDED_SYS_STATE": 2,
    "POSITION_TARGET_GLOBAL_INT": 2,
    "SYS_STATUS": 1,
    "BATTERY_STATUS": 1,
}
"""Messages of each kind in a second: 25."""


@dataclass
class Report:
    """What the vehicles sent and received; times are `time.monotonic`."""

    sent: dict[int, dict[int, float]] = field(default_factory=dict)
    """By system id and altitude in metres: when it was handed to the socket."""
    beats: dict[int, list[float]] = field(default_factory=dict)
    """By system id: when HEARTBEATs of the bridge came."""


def talk(talkers: list[Talker], every: int) -> Report:
    """Talk at `RATES`, each message in its turn of the second, until SIGTERM."""
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: ended.append(number))
    second = sorted(
        ((index + (number + 0.5) / len(talkers)) / rate, number, kind)
        for number in range(len(talkers))
        for kind, rate in RATES.items()
        for index in range(rate)
    )
    begun = time.monotonic()
    while not ended:
        for at, number, kind in second:
            while (wait := begun + at - time.monotonic()) > 0:
                for one in select.select(talkers, [], [], wait)[0]:
                    one.answer()
            talkers[number].send_kind(kind)
            if ended:
                break
        begun += 1.0
    sent = {one.system: {m: at for m, at in one.sent.items() if m % every == one.system % every} for one in talkers}
    return Report(sent, {one.system: one.beats for one in talkers})


def main() -> None:
    """Talk until SIGTERM, then print the report."""
    every, *where = sys.argv[1:]
    ends = [one.partition(":") for one in where]
    talkers = [Talker(int(system), ("127.0.0.1", int(port))) for system, _, port in ends]
    print("talking", flush=True)
    print(f"REPORT {msgspec.json.encode(talk(talkers, int(every))).decode()}", flush=True)


if __name__ == "__main__":
    main()
