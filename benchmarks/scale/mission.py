"""A mission of any number of vehicles that only talk, with their agents on one board, and the vehicles' process."""

from __future__ import annotations

import select
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.traffic import POSITIONS, RATES, Talker
from tests.support.ports import free_port

FLEET: Final = "scale"
MOST_POSITIONS: Final = 100
"""Positions a second, of all agents together, that plans print: their reader must not be what is measured."""
ASK_EVERY: Final = 1000
"""Milliseconds between the answer to an agent's question and its next one."""
_PROGRAM: Final = """\
!begin.
+!begin <- .wait(bridge(up), 300000); .print("serves"); !!ask_on.
+altitude(A) : every(K) & A mod K == 0 <- .print("at ", A).
+!ask_on <- .random(R); .wait(1000 * R); !!ask.
+!ask : pause(P)
  <- .nano_time(B);
     get_param("RTL_ALT");
     .nano_time(E);
     .print("asked ", (E - B) / 1000);
     .wait(P);
     !!ask.
-!ask[error_msg(Why)] : pause(P) <- .print("not told: ", Why); .wait(P); !!ask.
"""


@dataclass(frozen=True)
class Field:
    """A mission on disk, and where its vehicles meet their bridges."""

    mission: Path
    router: str
    ports: list[int]
    """Of the links on loopback: one for all, or one for each vehicle."""
    every: int
    """So many metres lie between two altitudes that a plan prints."""


def write_mission(folder: Path, size: int, *, own_links: bool) -> Field:
    """Write a mission of `size` vehicles, which share a link or have one each."""
    (folder / "watcher.asl").write_text(_PROGRAM)
    router = f"tcp/127.0.0.1:{free_port()}"
    shared = free_port()
    ports = [free_port() if own_links else shared for _ in range(size)]
    every = max(1, size * POSITIONS // MOST_POSITIONS)
    beliefs = f'beliefs: ["pause({ASK_EVERY})", "every({every})"]'
    agents = [f"  agent{one}: {{program: watcher.asl, robot: uav{one}, {beliefs}}}" for one in range(1, size + 1)]
    robots = [
        f"  uav{one}: {{manifest: arducopter, link: 'udpin:127.0.0.1:{port}', sysid: {one}}}"
        for one, port in enumerate(ports, 1)
    ]
    lines = [f"mission: {FLEET}", "agents:", *agents, "robots:", *robots, f"router: {{endpoint: {router}}}", ""]
    mission = folder / "scale.yaml"
    mission.write_text("\n".join(lines))
    return Field(mission, router, ports, every)


PARAMETER: Final = 1500.0
"""What every parameter is."""


@dataclass
class Told:
    """What the vehicles have to tell; times are `time.monotonic`."""

    sent: dict[int, dict[int, float]] = field(default_factory=dict)
    """By system id and altitude in metres: when it was handed to the socket."""
    beats: dict[int, list[float]] = field(default_factory=dict)
    """By system id: when HEARTBEATs of the bridge came."""


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
        for at, number, kind in second:
            while (wait := begun + at - time.monotonic()) > 0:
                for one in select.select(vehicles, [], [], wait)[0]:
                    one.answer()
            vehicles[number].tell(kind)
            if ended:
                break
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
