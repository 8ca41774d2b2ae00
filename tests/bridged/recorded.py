"""The recordings of a real ArduCopter, packet by packet."""

import gzip
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Framer, WireCounters

DATA = Path(__file__).parent.parent / "data"
PX4 = "px4/quad_flight"
"""What a PX4 copter said in a flight: heartbeats, texts, and a tenth of its telemetry."""
RECORDINGS = sorted(path.name.removesuffix(".tlog.gz") for path in DATA.glob("*.tlog.gz"))


class Packet(NamedTuple):
    """One packet: when it passed (seconds since the first one), its bytes, and what the driver's framer made of it."""

    at: float
    raw: bytes
    message: dialect.MAVLink_message


def packets(name: str) -> Iterator[Packet]:
    """Read a recording, each packet through the driver's own framer."""
    data = gzip.decompress((DATA / f"{name}.tlog.gz").read_bytes())
    framer, at, start = Framer(WireCounters()), 0, None
    while at < len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        at += 8
        size = 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
        raw = data[at : at + size]
        at += size
        start = stamp if start is None else start
        for message in framer.feed(raw):
            yield Packet((stamp - start) / 1e6, raw, message)


def packet_count(name: str) -> int:
    """How many packets a recording holds, by its own framing."""
    data, at, count = gzip.decompress((DATA / f"{name}.tlog.gz").read_bytes()), 0, 0
    while at < len(data):
        at += 8
        at += 12 + data[at + 1] + (13 if data[at + 2] & 1 else 0)
        count += 1
    return count


def start_of(name: str) -> int:
    """Unix microseconds of the first packet."""
    (stamp,) = struct.unpack_from(">Q", gzip.decompress((DATA / f"{name}.tlog.gz").read_bytes()), 0)
    return int(stamp)


def moments(name: str) -> dict[str, float]:
    """When each exchange of the recording began, in seconds since its first packet, by the name in its index.

    What the recorder waited for has its own moment: `NAME.seen`.
    """
    index = json.loads((DATA / "INDEX.json").read_text())
    first = start_of(name)
    times = {entry["name"]: (entry["t_us"] - first) / 1e6 for entry in index[f"{name}.tlog.gz"]}
    for entry in index[f"{name}.tlog.gz"]:
        if "t_seen_us" in entry:
            times[f"{entry['name']}.seen"] = (entry["t_seen_us"] - first) / 1e6
    return times
