"""The MAVLink driver as `bridged.drivers` finds it."""

from __future__ import annotations

from collections.abc import Iterable

from bridged.drivers.mavlink.address import FORMS, LinkAddress, LinkAddressError
from bridged.drivers.robot import Driver, Setup
from schemas.findings import Finding
from schemas.manifest import Manifest
from schemas.mission import Robot


def check_manifest(manifest: Manifest) -> Iterable[Finding]:
    """Say what the driver does not know: vehicle, sources, fields, commands, confirmations."""
    from bridged.drivers.mavlink.vocabulary import check_manifest as check

    return check(manifest)


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    """Say what is wrong with the link to a vehicle."""
    if not robot.link:
        yield "link", f"needs the field `link`: {FORMS}"
        return
    try:
        LinkAddress.parse(robot.link)
    except LinkAddressError as error:
        yield "link", str(error)


def make_driver(setup: Setup) -> Driver:
    """Make the driver of one vehicle."""
    from bridged.drivers.mavlink.driver import MavlinkDriver

    return MavlinkDriver(setup.manifest, setup.robot, setup.clock, setup.on_reading, setup.on_step)
