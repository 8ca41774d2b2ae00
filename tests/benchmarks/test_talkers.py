"""Vehicles that only talk say as much as a copter did whose flight was recorded."""

import gzip
import math
import struct
from collections.abc import Sequence

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.measurements.vehicles import RATES, Talker
from benchmarks.results import ROOT


def test_a_talker_tells_as_much_that_is_new_as_a_copter_in_a_recorded_flight() -> None:
    recorded = _recorded()
    talker = _Kept(1, ("127.0.0.1", 9))
    for _ in range(200):
        talker.send_kind("GLOBAL_POSITION_INT")
    talker.close()
    ours = [(0.1 * number, one) for number, one in enumerate(talker.kept)]
    copter, circle = _percepts(recorded), _percepts(ours)
    assert copter["position"] > 8
    assert circle["position"] == pytest.approx(copter["position"], rel=0.2)
    for what in ("heading", "velocity"):
        assert copter[what] <= circle[what] <= 2.1, (
            "no less than the flight, and no more than the manifest lets through"
        )
    assert RATES["GLOBAL_POSITION_INT"] == 10


class _Kept(Talker):
    def __post_init__(self) -> None:
        super().__post_init__()
        self.kept: list[dialect.MAVLink_message] = []

    def send(self, message: dialect.MAVLink_message) -> float:
        self.kept.append(message)
        return 0.0


def _recorded() -> list[tuple[float, dialect.MAVLink_message]]:
    """Return the positions of a flight, by the seconds at which they came, while the copter was on its way."""
    data = gzip.decompress((ROOT / "tests/data/single_uav.tlog.gz").read_bytes())
    protocol, at, found = dialect.MAVLink(None), 0, []
    while at < len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        size = 12 + data[at + 9] + (13 if data[at + 10] & 1 else 0)
        message = protocol.decode(bytearray(data[at + 8 : at + 8 + size]))
        at += 8 + size
        if message.get_type() == "GLOBAL_POSITION_INT" and math.hypot(message.vx, message.vy) > 100:
            found.append((stamp / 1e6, message))
    return found


def _percepts(positions: list[tuple[float, dialect.MAVLink_message]]) -> dict[str, float]:
    """Return the percepts a second that the manifest's rates and deadbands let through of moving copters' positions."""
    seconds = 0.1 * len(positions)  # ten a second are sent; those at rest were left out

    def reported(rate: float, deadband: float, values: list[Sequence[float]]) -> float:
        last_at, last, count = -math.inf, values[0], 0
        for (at, _), now in zip(positions, values, strict=True):
            differs = any(abs(new - old) > deadband for new, old in zip(now, last, strict=True))
            if at - last_at >= 1 / rate - 0.02 and (differs or not count):
                last_at, last, count = at, now, count + 1
        return count / seconds

    return {
        "position": reported(10, 0.0, [(one.lat, one.lon) for _, one in positions]),
        "heading": reported(2, 1.0, [(one.hdg / 100,) for _, one in positions]),
        "velocity": reported(2, 0.1, [(one.vx / 100, one.vy / 100) for _, one in positions]),
    }
