"""Which missions cannot be tried in virtual time: those with other edges than a trial has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from argosy.processes.simulators import ON_MAVLINK, vehicle_of
from argosy.trial.process import SIMULATED
from bridged.bridge.robot_setup import prepare
from schemas.files.findings import Finding
from schemas.mission.model import Mission

DRIVERS: Final = ("mavlink", "zenoh")
"""Drivers whose input and output a trial has in virtual time."""


def refusals(mission: Mission) -> list[Finding]:
    """Return why a mission, which is free of errors, cannot be tried; empty: it can."""
    return list(_refusals(mission))


def _refusals(mission: Mission) -> Iterator[Finding]:
    at = mission.positions.finding
    if mission.secured:
        yield at(("security",), "`security`: a trial has no TLS; expected a mission without it")
    if mission.gateway is not None:
        yield at(("gateway",), "`gateway`: a trial has no sockets for Comm nodes; expected a mission without it")
    if mission.router.external:
        yield at(("router",), "`external: true`: a trial has a network of its own; expected the boards' own routers")
    for name, robot in mission.robots.items():
        vehicle = vehicle_of(robot)
        if robot.simulate is None:
            yield at(("robots", name), f"{name} has no `simulate`: a trial has simulated robots alone")
            continue
        drivers = prepare(mission, name, None, 1.0)[1].manifest.drivers()
        if others := [one for one in drivers if one not in DRIVERS]:
            text = f"{name} uses driver {', '.join(others)}, which has its own clock; a trial has {', '.join(DRIVERS)}"
            yield at(("robots", name, "manifest"), text)
        if vehicle not in SIMULATED:
            yield at(
                ("robots", name, "simulate"),
                f"{name} simulates {vehicle or 'itself by its driver'}: expected `vehicle` to be one of "
                f"{', '.join(SIMULATED)}, which a trial has in virtual time",
            )
        elif vehicle in ON_MAVLINK and not robot.link.startswith("udp"):
            yield at(("robots", name, "link"), f"{name} has link {robot.link}: expected udpin: or udpout: in a trial")
