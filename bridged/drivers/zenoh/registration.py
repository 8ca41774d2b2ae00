"""The Zenoh driver as `bridged.drivers` finds it."""

from __future__ import annotations

from collections.abc import Iterable

from bridged.drivers.api import Driver, Order, Setup
from schemas.files.findings import Finding
from schemas.manifest.loader import Manifest
from schemas.mission.model import Robot

ORDERS: frozenset[Order] = frozenset()
"""What a robot of this driver can be ordered without an action of its manifest."""


def check_manifest(manifest: Manifest) -> Iterable[Finding]:
    """Say what the driver does not know, and which keys are none."""
    from bridged.drivers.zenoh.manifest_validation import check_manifest as check

    return check(manifest)


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    """Say what is wrong with the prefix of a robot's keys; there may be none."""
    from bridged.drivers.zenoh.manifest_validation import key_problem

    if robot.prefix and (problem := key_problem(robot.prefix)):
        yield "prefix", problem


def make_driver(setup: Setup) -> Driver:
    """Make the driver of one robot."""
    from bridged.drivers.zenoh.driver import ZenohDriver

    return ZenohDriver(setup)
