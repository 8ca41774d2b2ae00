"""A flight by a plain pymavlink script: `MAVLINK20=1 python -m tests.bridged.clients.pymavlink_flight udpin:HOST:PORT`.

It does what such scripts do: streams by REQUEST_DATA_STREAM, commands by COMMAND_LONG, a setpoint, waiting by polling.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

from pymavlink import mavutil

LAT, LON, HEIGHT = -276036830, -485180520, 15.0


def done(step: str) -> None:
    print(step, flush=True)


class Script:
    def __init__(self, address: str) -> None:
        self.link = mavutil.mavlink_connection(address, source_system=255, source_component=190)
        if self.link.wait_heartbeat(timeout=90) is None:
            raise SystemExit("pymavlink: no heartbeat in 15 s")
        self.beat_at = 0.0

    def until(self, kind: str, wish: Callable[[Any], bool], what: str, seconds: float = 90.0) -> Any:
        end, last = time.monotonic() + seconds, None
        while time.monotonic() < end:
            if time.monotonic() - self.beat_at > 1.0:
                self.beat_at = time.monotonic()
                self.link.mav.heartbeat_send(6, 8, 0, 0, 0)
            message = self.link.recv_match(type=[kind], blocking=True, timeout=1.0)
            if message is not None:
                last = message
                if wish(message):
                    return message
        raise SystemExit(f"pymavlink: no {what} in {seconds:g} s, last: {last}")

    def command(self, number: int, *params: float) -> None:
        padded = (*params, *([0.0] * (7 - len(params))))
        self.link.mav.command_long_send(0, 0, number, 0, *padded)  # 0/0: to everybody, as old scripts do
        ack = self.until("COMMAND_ACK", lambda ack: ack.command == number, f"COMMAND_ACK {number}")
        if ack.result != 0:
            raise SystemExit(f"pymavlink: command {number} was answered with {ack.result}")

    def fly(self) -> None:
        done("connected")
        self.link.mav.request_data_stream_send(1, 1, 0, 4, 1)
        self.until("EKF_STATUS_REPORT", lambda report: report.flags & 16, "position")
        done("healthy")
        self.command(176, 1, 4)
        self.command(400, 1)
        self.until("HEARTBEAT", lambda beat: beat.base_mode & 128, "arming")
        done("armed")
        self.command(22, 0, 0, 0, 0, 0, 0, 5)
        self.until("GLOBAL_POSITION_INT", lambda at: abs(at.relative_alt - 5000) < 300, "takeoff")
        done("taken off")
        self.link.mav.set_position_target_global_int_send(0, 1, 1, 6, 3576, LAT, LON, HEIGHT, 0, 0, 0, 0, 0, 0, 0, 0)
        self.until(
            "GLOBAL_POSITION_INT",
            lambda at: abs(at.lat - LAT) < 50 and abs(at.lon - LON) < 50 and abs(at.relative_alt - 15000) < 300,
            "arrival",
        )
        done("arrived")
        self.command(21)
        self.until("HEARTBEAT", lambda beat: not beat.base_mode & 128, "disarming", 60.0)
        done("landed and disarmed")


if __name__ == "__main__":
    Script(sys.argv[1]).fly()
