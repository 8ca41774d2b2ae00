"""A ground station by pymavlink's mavutil that watches a vehicle, and sets its mode when it is told to."""

from __future__ import annotations

import sys

from pymavlink import mavutil


def main(link: str, mode: str) -> None:
    """Says what it hears; sets the mode when a line comes in."""
    station = mavutil.mavlink_connection(link, source_system=255, source_component=230)
    assert station.wait_heartbeat(timeout=20) is not None
    print(f"heard system {station.target_system}", flush=True)
    assert station.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=20) is not None
    print("sees where it is", flush=True)
    sys.stdin.readline()
    station.set_mode(mode)
    while True:
        beat = station.recv_match(type="HEARTBEAT", blocking=True, timeout=20)
        assert beat is not None
        if beat.get_srcSystem() == 1 and station.flightmode == mode:
            break
    print(f"mode {mode}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
