"""Vehicles that only talk, as a process of its own: `python -m benchmarks.scale.talkers EVERY ID:PORT...`.

They talk as `benchmarks.bridge.traffic` has it until SIGTERM, then tell in one line of JSON what they have sent and
heard (`Told`). They answer questions for parameters at once.
"""

from __future__ import annotations

import select
import signal
import sys
import time
from dataclasses import dataclass, field
from typing import Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.bridge.traffic import RATES, Talker

PARAMETER: Final = 1500.0
"""What every parameter is."""


@dataclass
class Told:
    """What the vehicles have to tell; times are `time.monotonic`."""

    sent: dict[int, dict[int, float]] = field(default_factory=dict)
    """By system id and altitude in metres: when it was handed to the socket."""
    beats: dict[int, list[float]] = field(default_factory=dict)
    """By system id: when HEARTBEATs of the bridge came."""
    late: list[float] = field(default_factory=list)
    """Of each second: its time, and the seconds by which the vehicles were late at worst."""


class Vehicle(Talker):
    """A talker that answers questions for parameters and hears the bridge's heartbeats."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.beats: list[float] = []

    def _take(self, message: dialect.MAVLink_message) -> None:
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self.beats.append(time.monotonic())
        elif kind == "PARAM_REQUEST_READ" and message.target_system == self.system:
            self.send(dialect.MAVLink_param_value_message(message.param_id.encode(), PARAMETER, 9, 1, 0))
        else:
            super()._take(message)


def talk(vehicles: list[Vehicle], every: int) -> Told:
    """Talk, each message in its turn of the second, until SIGTERM."""
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: ended.append(number))
    second = sorted(
        ((index + (number + 0.5) / len(vehicles)) / rate, number, kind)
        for number in range(len(vehicles))
        for kind, rate in RATES.items()
        for index in range(rate)
    )
    told, begun = Told(), time.monotonic()
    while not ended:
        worst = 0.0
        for at, number, kind in second:
            while (wait := begun + at - time.monotonic()) > 0:
                for one in select.select(vehicles, [], [], wait)[0]:
                    one.answer()
            worst = max(worst, -wait)
            vehicles[number].tell(kind)
            if ended:
                break
        told.late += [time.monotonic(), worst]
        begun += 1.0
    for one in vehicles:
        told.sent[one.system] = {metres: at for metres, at in one.sent.items() if metres % every == 0}
        told.beats[one.system] = one.beats
    return told


def main() -> None:
    """Talk, and tell."""
    every, *where = sys.argv[1:]
    vehicles = []
    for one in where:
        system, _, port = one.partition(":")
        vehicles.append(Vehicle(int(system), ("127.0.0.1", int(port))))
    print("talking", flush=True)
    print(f"TOLD {msgspec.json.encode(talk(vehicles, int(every))).decode()}", flush=True)


if __name__ == "__main__":
    main()
