"""A mission of any number of UAVs with their agents on one board: what `benchmarks.scale.part` flies."""

from __future__ import annotations

import select
import signal
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.traffic import RATES, Talker
from tests.support.ports import free_port

FLEET: Final = "scale"
Vehicles = Literal["copters", "talkers"]
"""Simulated copters that fly, or what only talks as copters do."""
MOST_POSITIONS: Final = 100
"""Positions a second, of all agents together, that plans print: their reader must not be what is measured."""
ASK_EVERY: Final = 1000
"""Milliseconds between the answer to an agent's question and its next one."""
SPACING: Final = 2e-4
"""Degrees between two homes, some 20 m."""
FIELD: Final = (-27.604033, -48.518363, 21.0)
_WATCHER: Final = """\
!begin.
+!begin <- .wait(bridge(up), 300000); .print("serves"); !!ask_on.
+altitude(A) : every(K) & A mod K == 0 <- .print("at ", A).
"""
_ASKS: Final = """\
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
_FLYER: Final = """\
!begin.
+!begin
  <- .wait(bridge(up), 300000);
     set_mode("GUIDED");
     arm_motors(true);
     takeoff(10);
     .print("serves");
     !!ask_on;
     !!patrol.
-!begin[error_msg(Why)] <- .print("begins again: ", Why); .wait(2000); !!begin.
+!patrol : post(Lat, Lon, Away) <- goto(Away, Lon, 10); goto(Lat, Lon, 10); !!patrol.
-!patrol[error_msg(Why)] <- .print("turned back: ", Why); .wait(1000); !!patrol.
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


def name_of(number: int) -> str:
    """Return the name of a vehicle's agent by the vehicle's system id."""
    return f"agent{number}"


def write_mission(folder: Path, vehicles: Vehicles, size: int, *, own_links: bool, talker: int = 0) -> Field:
    """Write a mission of `size` UAVs. `talker` is the system id of one more, which only talks; 0: there is none."""
    (folder / "watcher.asl").write_text(_WATCHER + _ASKS)
    (folder / "flyer.asl").write_text(_FLYER + _ASKS)
    router = f"tcp/127.0.0.1:{free_port()}"
    ids = [*range(1, size + 1), *([talker] if talker else [])]
    shared = free_port()
    ports = [free_port() if own_links else shared for _ in ids]
    talk = {one for one in ids if vehicles == "talkers" or one == talker}
    every = max(1, len(talk) * 10 // MOST_POSITIONS)
    agents, robots = [], []
    for number, port in zip(ids, ports, strict=True):
        flies = number not in talk
        lat, lon = FIELD[0] + SPACING * (number // 16), FIELD[1] + SPACING * (number % 16)
        told = f'"post({lat:.7f}, {lon:.7f}, {lat + SPACING / 2:.7f})"' if flies else f'"every({every})"'
        program = "flyer" if flies else "watcher"
        agents.append(
            f"  {name_of(number)}: {{program: {program}.asl, robot: uav{number}, "
            f'beliefs: ["pause({ASK_EVERY})", {told}]}}'
        )
        simulate = f", simulate: {{home: [{lat:.7f}, {lon:.7f}, {FIELD[2]}]}}" if flies else ""
        link = f"link: 'udpin:127.0.0.1:{port}', sysid: {number}"
        robots.append(f"  uav{number}: {{manifest: arducopter, {link}{simulate}}}")
    lines = ["mission: scale", "agents:", *agents, "robots:", *robots, f"router: {{endpoint: {router}}}", ""]
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
