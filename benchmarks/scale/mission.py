"""A mission of any number of UAVs with their agents on one board: what `benchmarks.scale.part` flies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

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
