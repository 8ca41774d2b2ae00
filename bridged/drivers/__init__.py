"""Drivers: how the bridge talks to robots.

A driver is named by the manifest's `robot.driver`. This table is the one place that knows them all.
"""

from __future__ import annotations

from collections.abc import Callable

from bridged.drivers.robot import Driver, OnReading
from commd.clock import Clock
from schemas.findings import Finding
from schemas.manifest import Manifest
from schemas.mission import Robot

DRIVERS = ("mavlink",)


def check_manifest(manifest: Manifest) -> list[Finding]:
    """Say what the manifest's driver does not know in it, each at its line; no such driver is one finding."""
    match manifest.robot.driver:
        case "mavlink":
            from bridged.drivers.mavlink.vocabulary import check_manifest as check

            return check(manifest)
        case unknown:
            known = ", ".join(DRIVERS)
            return [manifest.finding(f"robot.driver: no driver `{unknown}`, there is {known}", "robot", "driver")]


def check_link(manifest: Manifest, link: str) -> None:
    """Raise ValueError, in words, for a link string that the manifest's driver cannot understand."""
    if manifest.robot.driver == "mavlink":
        from bridged.drivers.mavlink.address import LinkAddress

        LinkAddress.parse(link)


def make_driver(
    manifest: Manifest, robot: Robot, clock: Clock, on_reading: OnReading, on_step: Callable[[], None]
) -> Driver:
    """Make the driver of a manifest that `check_manifest` found nothing wrong with.

    `on_reading` is called with what the robot says, `on_step` after the driver has looked at its executions. Raises
    ValueError for a link string that cannot be understood.
    """
    from bridged.drivers.mavlink.driver import MavlinkDriver

    return MavlinkDriver(manifest, robot, clock, on_reading, on_step)
